"""The program that damages inputs sees what must not become of them, and goes on where it was stopped."""

from __future__ import annotations

import json
import random
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import fuzz
import fuzz_files
import sources_builder as build
from fuzz import State, load_state, recording_outcome
from recording_builder import write_recording
from spoil_recording import own_files, spoil

from anchorpose.errors import InputError

QUICK = ("npy", "record3d")


def content(folder: Path) -> dict[str, str]:
    found = sorted(folder.rglob("*"))
    return {
        path.name: repr(path.read_bytes() if path.is_file() and not path.is_symlink() else path.lstat().st_mode)
        for path in found
        if path.is_symlink() or path.lstat().st_size < 1 << 30
    }


def test_the_same_number_spoils_in_the_same_way(tmp_path):
    for number in range(40):
        one, other = (write_recording(tmp_path / f"{number}-{k}", frames=2) for k in range(2))
        assert spoil(one, number) == spoil(other, number)
        assert content(one) == content(other)


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


@pytest.mark.thorough
def test_a_run_that_was_stopped_goes_on_and_its_counts_add_up(tmp_path):
    for cases in (15, 30):
        assert run_apart(tmp_path, "pass", cases).returncode == 0
        state = load_state(tmp_path / "state")
        assert state.next == cases
        assert state.read + state.refused == cases
        assert state.faults == []


@pytest.mark.thorough
@pytest.mark.parametrize("strange", ["raise KeyError('x')", "numpy.ones(1 << 30)"])
def test_another_error_and_too_much_memory_are_faults(tmp_path, strange):
    assert run_apart(tmp_path, strange, 2).returncode == 0
    assert len(load_state(tmp_path / "state").faults) == 2


@pytest.mark.thorough
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


def test_what_was_made_huge_is_not_read_to_be_spoilt_once_more(tmp_path):
    folder = write_recording(tmp_path / "r", frames=1)
    for path in own_files(folder):
        with path.open("r+b") as file:
            file.truncate(1 << 40)
    assert own_files(folder) == []


def test_the_state_is_whole_or_not_there(tmp_path):
    State(next=7, faults=["x"]).save(tmp_path / "state.json")
    assert load_state(tmp_path / "state.json") == State(next=7, faults=["x"])
    assert json.loads((tmp_path / "state.json").read_text())["next"] == 7
    assert [path.name for path in tmp_path.iterdir()] == ["state.json"]
    assert load_state(tmp_path / "none.json") == State()


def refuse(*, elsewhere: bool = False, remedy: str = "record again", leave: bool = False):
    """A conversion that refuses its input, also wrongly."""

    def converted(path: Path, out: Path) -> None:
        if leave:
            out.mkdir()
        raise InputError("elsewhere" if elsewhere else path, "it is damaged", remedy)

    return converted


def test_a_refusal_and_a_recording_are_counted(tmp_path, monkeypatch):
    build.npy(tmp_path / "in", build.noise(3))
    assert fuzz_files.file_outcome(tmp_path / "in", tmp_path / "out", None) == "read"
    whole = fuzz_files.depth_images(tmp_path / "out")
    shutil.rmtree(tmp_path / "out")
    assert fuzz_files.file_outcome(tmp_path / "in", tmp_path / "out", whole) == "read"
    monkeypatch.setattr(fuzz_files, "converted", refuse())
    assert fuzz_files.file_outcome(tmp_path / "in", tmp_path / "no", None) == "refused"


@pytest.mark.parametrize(
    ("converted", "what"),
    [
        (refuse(remedy="record\nagain"), "no sentence"),
        (refuse(elsewhere=True), "no sentence"),
        (refuse(leave=True), "left a folder"),
    ],
)
def test_a_refusal_that_is_none_is_a_fault(tmp_path, monkeypatch, converted, what):
    monkeypatch.setattr(fuzz_files, "converted", converted)
    with pytest.raises(fuzz_files.Fault, match=what):
        fuzz_files.file_outcome(tmp_path / "in", tmp_path / "out", None)


def test_an_image_that_was_not_recorded_is_a_fault(tmp_path):
    build.npy(tmp_path / "in", build.noise(3))
    with pytest.raises(fuzz_files.Fault, match="not recorded"):
        fuzz_files.file_outcome(tmp_path / "in", tmp_path / "out", [np.zeros(3).tobytes()])


@pytest.mark.slow  # a stopped run of one kind goes on in every run of the tests
def test_every_kind_runs_and_a_run_that_was_stopped_goes_on(tmp_path):
    kinds = (*QUICK, "recordings")
    program = [sys.executable, fuzz.__file__, *kinds, "--state", str(tmp_path / "states"), "--cases"]
    for cases in (3, 5):
        done = subprocess.run([*program, str(cases)], check=False, capture_output=True, text=True, timeout=100)
        assert done.returncode == 0, done.stdout + done.stderr
        assert [line.split(":")[:2] for line in done.stdout.splitlines()] == [[k, f" {cases} cases"] for k in kinds]


def test_a_kind_that_is_unknown_is_refused():
    command = [sys.executable, fuzz.__file__, "jpeg"]
    assert "there is no jpeg" in subprocess.run(command, check=False, capture_output=True, text=True).stderr


def test_a_cut_is_known_as_one():
    data, cuts = bytes(range(256)) * 8, 0
    for k in range(200):
        changed, cut = fuzz_files.damaged(data, random.Random(k))
        cuts += cut
        assert not cut or data.startswith(changed)
    assert 20 < cuts < 120
