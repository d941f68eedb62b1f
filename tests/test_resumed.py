"""A run that is stopped again and again ends with the same bytes as one that never was."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from anchorpose.errors import InputError
from anchorpose.pipeline import track_recording
from anchorpose.results.folder import unfinished_results
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker import journal, passes
from anchorpose.tracker.config import TrackConfig

FRAMES, FPS = 8, 8.0
WRITES = 3  # between two stops


class Killed(BaseException):
    """Stands for a signal: no code of the run handles it."""


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("resumed")
    simulate_recording(folder / "out", single(6, seconds=FRAMES / FPS, fps=FPS))
    return folder / "out/recording"


def track(recording: Path, results: Path, config: TrackConfig) -> None:
    with unfinished_results(results, recording, resume=True) as folder:
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
