"""The program that damages files sees what a conversion must not do."""

from __future__ import annotations

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
import fuzz_readers
import sources_builder as build

from anchorpose.errors import InputError

QUICK = ("npy", "record3d")


def refuse(*, elsewhere: bool = False, remedy: str = "record again", leave: bool = False):
    """A conversion that refuses its input, also wrongly."""

    def converted(path: Path, out: Path) -> None:
        if leave:
            out.mkdir()
        raise InputError("elsewhere" if elsewhere else path, "it is damaged", remedy)

    return converted


def test_a_refusal_and_a_recording_are_counted(tmp_path, monkeypatch):
    build.npy(tmp_path / "in", build.noise(3))
    assert fuzz_readers.outcome(tmp_path / "in", tmp_path / "out", None) == "read"
    whole = fuzz_readers.depth_images(tmp_path / "out")
    shutil.rmtree(tmp_path / "out")
    assert fuzz_readers.outcome(tmp_path / "in", tmp_path / "out", whole) == "read"
    monkeypatch.setattr(fuzz_readers, "converted", refuse())
    assert fuzz_readers.outcome(tmp_path / "in", tmp_path / "no", None) == "refused"


@pytest.mark.parametrize(
    ("converted", "what"),
    [
        (refuse(remedy="record\nagain"), "no sentence"),
        (refuse(elsewhere=True), "no sentence"),
        (refuse(leave=True), "left a folder"),
    ],
)
def test_a_refusal_that_is_none_is_a_fault(tmp_path, monkeypatch, converted, what):
    monkeypatch.setattr(fuzz_readers, "converted", converted)
    with pytest.raises(fuzz_readers.Fault, match=what):
        fuzz_readers.outcome(tmp_path / "in", tmp_path / "out", None)


def test_an_image_that_was_not_recorded_is_a_fault(tmp_path):
    build.npy(tmp_path / "in", build.noise(3))
    with pytest.raises(fuzz_readers.Fault, match="not recorded"):
        fuzz_readers.outcome(tmp_path / "in", tmp_path / "out", [np.zeros(3).tobytes()])


def test_a_process_that_hangs_or_crashes_ends_with_the_number_of_its_file(tmp_path):
    ends = {"time.sleep(9)": signal.SIGALRM, "spin()": signal.SIGPROF, "os.abort()": signal.SIGABRT}
    for what, number in ends.items():
        script = (
            "import os, sys, time; sys.path.insert(0, sys.argv[1]); import fuzz_readers as f\n"
            "from pathlib import Path\n"
            "import fuzz_recordings; fuzz_recordings.BY_THE_CLOCK = 1 if 'sleep' in sys.argv[2] else 60\n"
            "f.name_place_of_death(); f.LONGEST_S = 1\n"
            "def spin():\n    while True: pass\n"
            f"f.outcome = lambda *given: {what}\n"
            "path = Path(sys.argv[2]) / 'state'; f.State(next=7).save(path)\n"
            "f.run_reader('npy', 9, path.parent, path)\n"
        )
        folder = tmp_path / what
        folder.mkdir()
        paths = [str(Path(fuzz_readers.__file__).parent), str(folder)]
        done = subprocess.run([sys.executable, "-c", script, *paths], check=False, capture_output=True, timeout=60)
        assert done.returncode == -number
        assert (folder / "number").read_text() == "7 npy"


def test_every_reader_runs_and_a_run_that_was_stopped_goes_on(tmp_path):
    program = [
        sys.executable,
        fuzz_readers.__file__,
        "--state",
        str(tmp_path / "states"),
        "--reader",
        *QUICK,
        "--files",
    ]
    for files in (3, 5):
        done = subprocess.run([*program, str(files)], check=False, capture_output=True, text=True, timeout=100)
        assert done.returncode == 0, done.stdout + done.stderr
        assert [line.split(":")[:2] for line in done.stdout.splitlines()] == [[k, f" {files} cases"] for k in QUICK]


def test_a_cut_is_known_as_one():
    data, cuts = bytes(range(256)) * 8, 0
    for k in range(200):
        changed, cut = fuzz_readers.damage(data, random.Random(k))
        cuts += cut
        assert not cut or data.startswith(changed)
    assert 20 < cuts < 120
