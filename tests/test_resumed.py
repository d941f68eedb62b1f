"""A run that is stopped again and again ends with the same bytes as one that never was."""

import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from anchorpose.errors import InputError
from anchorpose.pipeline import track_recording
from anchorpose.results.unfinished import unfinished_results
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker import journal, passes
from anchorpose.tracker.config import TrackConfig

pytestmark = pytest.mark.thorough

FRAMES, FPS = 8, 8.0
WRITES = 3  # between two stops


class Killed(BaseException):
    """Stands for a signal: no code of the run handles it."""


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("resumed")
    simulate_recording(folder / "out", single(6, seconds=FRAMES / FPS, fps=FPS))
    return folder / "out/recording"


def track(recording: Path, results: Path, config: TrackConfig, overwrite: bool = False) -> None:
    with unfinished_results(results, recording, overwrite=overwrite, resume=not overwrite) as folder:
        track_recording(recording, folder, config, lambda done, total: None)


def stop_after(monkeypatch: pytest.MonkeyPatch, writes: int) -> None:
    """The write after that many is cut off."""
    left = [writes]

    def write(path: Path, data: bytes) -> None:
        left[0] -= 1
        if left[0] < 0:
            path.with_name(path.name + ".partial").write_bytes(data[: len(data) // 2])
            raise Killed
        whole(path, data)

    whole = journal.write_whole
    monkeypatch.setattr(journal, "write_whole", write)


TIMED = ("report.html", "run.json", "log.jsonl")


def content(results: Path) -> dict[str, bytes]:
    files = {path.relative_to(results).as_posix(): path for path in results.rglob("*") if path.is_file()}
    found = {name: path.read_bytes() for name, path in files.items() if name not in TIMED}
    run = json.loads((results / "run.json").read_text())
    del run["timings"]
    return found | {"run.json": json.dumps(run).encode()}


@pytest.mark.parametrize("smooth", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_stopped_and_undisturbed_runs_have_the_same_bytes(recording, tmp_path, monkeypatch, smooth):
    monkeypatch.setattr(passes, "BLOCK", 3)
    config = replace(TrackConfig(), smooth=smooth)
    track(recording, tmp_path / "whole", config)
    stops = 0
    while not (tmp_path / "stopped").exists():
        with monkeypatch.context() as patched:
            stop_after(patched, WRITES)
            try:
                track(recording, tmp_path / "stopped", config)
            except Killed:
                stops += 1
        assert stops < 30, "the run does not come to its end"
    assert stops >= 2
    assert content(tmp_path / "stopped") == content(tmp_path / "whole")
    assert {path.name for path in tmp_path.iterdir()} == {"stopped", "whole"}


def test_a_recording_that_changed_meanwhile_is_not_continued(recording, tmp_path, monkeypatch):
    stop_after(monkeypatch, 1)
    with pytest.raises(Killed):
        track(recording, tmp_path / "out", TrackConfig())
    image = recording / "front/depth/000007.png"
    image.write_bytes(image.read_bytes() + b"\0")
    with pytest.raises(InputError, match=r"was begun before front/depth/000007\.png changed"):
        track(recording, tmp_path / "out", TrackConfig())
    assert list(tmp_path.glob(".out.unfinished/journal/learnt"))


SPOILT = {
    "learnt": lambda path: path.write_bytes(b""),
    "forward/state": lambda path: os.truncate(path, 100),
    "forward/000000.frames": Path.unlink,
    "forward/000001.frames": lambda path: shutil.copy(path.with_name("000000.frames"), path),
    "start": lambda path: (path.unlink(), path.mkdir()),
    "forward": lambda path: (shutil.rmtree(path), os.mkfifo(path)),
}


def test_no_refusal_takes_anything_from_a_run_that_was_stopped_at_its_end(recording, tmp_path, monkeypatch):
    """Neither of a damaged journal, nor of inputs with --overwrite; the remedy of each refusal works."""

    def stop(results: Path) -> None:
        raise Killed

    image = recording / "front/depth/000007.png"
    image.write_bytes(image.read_bytes().removesuffix(b"\0"))
    monkeypatch.setattr("anchorpose.writing.write_report", stop)
    with pytest.raises(Killed):
        track(recording, tmp_path / "out", TrackConfig())
    work, kept = tmp_path / ".out.unfinished", tmp_path / "kept"
    assert {"run.json", "joints.parquet", "pictures"} <= {path.name for path in work.iterdir()}
    nowhere = replace(TrackConfig(), patient_xz_m=(0.0, 0.0), patient_frame=77)
    before = every_byte(work)
    with pytest.raises(InputError):
        track(recording, tmp_path / "out", nowhere, overwrite=True)
    assert every_byte(work) == before
    shutil.copytree(work, kept)
    for place, spoil in SPOILT.items():
        shutil.rmtree(work)
        shutil.copytree(kept, work)
        spoil(work / "journal" / place)
        before = every_byte(work)
        with pytest.raises(InputError, match=rf"journal/{place}: .*; remove .* and give the same command again") as no:
            track(recording, tmp_path / "out", TrackConfig())
        assert every_byte(work) == before
    shutil.rmtree(re.search("remove (.*) and give", str(no.value))[1])
    with pytest.raises(Killed):
        track(recording, tmp_path / "out", TrackConfig())


def every_byte(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}
