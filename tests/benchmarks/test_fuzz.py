"""The program that damages inputs sees what must not become of them, and goes on where it was stopped."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rosbags")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import fuzz
import fuzz_files
from fuzz import recording_outcome
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
