"""The program that spoils recordings counts what must not happen, and goes on where it was stopped."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import fuzz_recordings
from fuzz_recordings import State, load_state, outcome
from recording_builder import write_recording
from spoil_recording import own_files, spoil

from anchorpose.errors import InputError


def content(folder: Path) -> dict[str, str]:
    found = sorted(folder.rglob("*"))
    return {path.name: repr(path.read_bytes() if path.is_file() and not path.is_symlink() else path.lstat().st_mode)
            for path in found if path.is_symlink() or path.lstat().st_size < 1 << 30}  # fmt: skip


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

    monkeypatch.setattr(fuzz_recordings, "open_recording", refuse)
    with pytest.raises(ValueError, match="not one sentence"):
        outcome(tmp_path)


def run_apart(tmp_path: Path, change: str, cases: int) -> subprocess.CompletedProcess[str]:
    """A run in a process of its own, since it limits its memory."""
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); import fuzz_recordings as f; from pathlib import Path\n"
        "import os, time, numpy\n"
        f"f.name_place_of_death(); f.LONGEST_S = 1; f.BY_THE_CLOCK = {1 if 'sleep' in change else 60}\n"
        f"def strange(folder): {change}\n"
        f"{'f.outcome = strange' if change != 'pass' else ''}\n"
        f"folder = Path(sys.argv[2]); path = folder / 'state'; f.run_cases(f.load_state(path), {cases}, folder, path)"
    )
    paths = [str(Path(fuzz_recordings.__file__).parent), str(tmp_path)]
    return subprocess.run(
        [sys.executable, "-c", script, *paths], check=False, capture_output=True, text=True, timeout=100
    )


def test_a_run_that_was_stopped_goes_on_and_its_counts_add_up(tmp_path):
    for cases in (15, 30):
        assert run_apart(tmp_path, "pass", cases).returncode == 0
        state = load_state(tmp_path / "state")
        assert state.next == cases
        assert state.read + state.refused == cases
        assert state.faults == []


@pytest.mark.parametrize("strange", ["raise KeyError('x')", "numpy.ones(1 << 30)"])
def test_another_error_and_too_much_memory_are_faults(tmp_path, strange):
    assert run_apart(tmp_path, strange, 2).returncode == 0
    assert len(load_state(tmp_path / "state").faults) == 2


def test_a_case_that_hangs_or_crashes_ends_the_process_and_is_named(tmp_path):
    spin = "exec('while True: pass')"
    for strange, code in (("time.sleep(9)", -signal.SIGALRM), (spin, -signal.SIGPROF), ("os.abort()", -signal.SIGABRT)):
        assert run_apart(tmp_path, strange, 9).returncode == code
        assert (tmp_path / "number").read_text().startswith("0 ")


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
