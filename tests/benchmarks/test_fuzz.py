"""The program that damages inputs sees what must not become of them, and goes on where it was stopped."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rosbags")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import fuzz
import fuzz_files
from fuzz import load_state, recording_outcome
from recording_builder import write_recording
from spoil_recording import spoil

from anchorpose.errors import InputError

QUICK = ("npy", "record3d")


@pytest.mark.parametrize(
    "refusal", [InputError("elsewhere", "is bad", "mend it"), InputError("{}", "x" * 3000, "mend")]
)
def test_a_refusal_that_is_not_one_sentence_about_the_folder_is_a_fault(tmp_path, monkeypatch, refusal):
    def refuse(folder: Path) -> None:
        raise refusal

    monkeypatch.setattr(fuzz, "open_recording", refuse)
    with pytest.raises(fuzz_files.Fault, match="not one sentence"):
        recording_outcome(tmp_path)


def run_apart(folder: Path, change: str, cases: int, kind: str = "f.Recordings(folder)") -> subprocess.CompletedProcess:
    """A run in a process of its own, since it limits its memory; change: the body of what judges a case."""
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); import fuzz as f; from pathlib import Path\n"
        "import os, time, numpy\n"
        f"f.name_place_of_death(); f.BY_THE_CLOCK = {1 if 'sleep' in change else 60}\n"
        f"folder = Path(sys.argv[2]); path = folder / 'state'; fuzzer = {kind}\n"
        "if not path.exists(): f.State(next=7 if 'Files' in sys.argv[3] else 0).save(path)\n"
        f"def strange(): {change}\n"
        f"fuzzer.longest_s = 1\n{'fuzzer.outcome = strange' if change != 'pass' else ''}\n"
        f"f.run_cases(fuzzer, {cases}, folder, path)"
    )
    command = [sys.executable, "-c", script, str(Path(fuzz.__file__).parent), str(folder), kind]
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=100)


def test_a_run_that_was_stopped_goes_on_and_its_counts_add_up(tmp_path):
    for cases in (15, 30):
        assert run_apart(tmp_path, "pass", cases).returncode == 0
        state = load_state(tmp_path / "state")
        assert state.next == cases
        assert state.read + state.refused == cases
        assert state.faults == []


@pytest.mark.parametrize(
    ("kind", "first"), [("f.Recordings(folder)", "0 "), ("f.Files(folder, 'npy')", "7 npy")], ids=["recordings", "npy"]
)
def test_a_case_that_hangs_or_crashes_ends_the_process_and_is_named(tmp_path, kind, first):
    spin = "exec('while True: pass')"
    for strange, code in (("time.sleep(9)", -signal.SIGALRM), (spin, -signal.SIGPROF), ("os.abort()", -signal.SIGABRT)):
        folder = tmp_path / strange
        folder.mkdir()
        assert run_apart(folder, strange, 9, kind).returncode == code
        assert (folder / "number").read_text().startswith(first)


def test_nothing_outside_of_the_folder_is_touched(tmp_path):
    """A link may lead anywhere: to another recording, or to the whole disk."""
    outside = write_recording(tmp_path / "outside", frames=2)
    (outside / "seat.ply").write_bytes(b"ply")
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in outside.rglob("*") if path.is_file()}
    for number in range(300):
        folder = tmp_path / "bad"
        shutil.rmtree(folder, ignore_errors=True)
        write_recording(folder, frames=1, cameras=("front", "left"))
        for name in ("front", "left/depth", "recording.json", "equipment.json", "seat.ply"):
            if number % 5 != len(name) % 5 or name == "front":
                path = folder / name
                shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
                path.symlink_to(outside / name.replace("left", "front"))
        spoil(folder, number)
    after = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in outside.rglob("*") if path.is_file()}
    assert after == before


@pytest.mark.slow  # a stopped run of one kind goes on in every run of the tests
def test_every_kind_runs_and_a_run_that_was_stopped_goes_on(tmp_path):
    kinds = (*QUICK, "recordings")
    program = [sys.executable, fuzz.__file__, *kinds, "--state", str(tmp_path / "states"), "--cases"]
    for cases in (3, 5):
        done = subprocess.run([*program, str(cases)], check=False, capture_output=True, text=True, timeout=100)
        assert done.returncode == 0, done.stdout + done.stderr
        assert [line.split(":")[:2] for line in done.stdout.splitlines()] == [[k, f" {cases} cases"] for k in kinds]
