"""From a source that runs to joints at once and a finished results folder."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np
import pytest

from anchorpose.errors import AnchorposeError
from anchorpose.live.playback import Playback
from anchorpose.live.session import LiveOptions, track_live
from anchorpose.recording.reader import open_recording
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.results.unfinished import unfinished_results
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import TrackConfig

FPS, SECONDS = 10.0, 4.0


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("live")
    simulate_recording(folder / "out", single(6, seconds=SECONDS, fps=FPS))
    return folder / "out/recording"


class Again(Playback):
    """Plays a recording forward and backward without an end; loses its camera after some images if asked."""

    lose_after = None

    def images(self, stop):
        first_s, period_s, given = time.monotonic(), 1.0 / FPS, 0
        there = [*range(len(self._order)), *range(len(self._order) - 2, 0, -1)]
        while not stop.wait(max(first_s + given * period_s - time.monotonic(), 0.0)):
            if given == self.lose_after:
                raise AnchorposeError("no image came for 5 s; check its cable")
            grey = self._read(0, there[given % len(there)])
            yield self._image(given, given * period_s, first_s + given * period_s, grey)
            given += 1

    def _image(self, number, time_s, taken_s, grey):
        from anchorpose.live.source import LiveImage

        return LiveImage(0, number, time_s, taken_s, grey)


class Collecting:
    name = "collecting"

    def __init__(self, enough: int, stop: Event) -> None:
        self.frames, self._enough, self._stop = [], enough, stop

    def send(self, frame):
        self.frames.append(frame)
        if len(self.frames) == self._enough:
            self._stop.set()

    def close(self):
        pass


def run(source, results: Path, stop: Event, output: Collecting, options: LiveOptions | None = None):
    options = options or LiveOptions(config=TrackConfig())
    said = []
    with unfinished_results(results, results.parent / "nothing") as folder:
        summary = track_live([source], folder, options, [output], said.append, stop)
    return summary, said


@pytest.mark.slow
def test_frames_are_sent_while_they_happen_and_a_whole_results_folder_is_left(recording, tmp_path):
    stop = Event()
    output = Collecting(30, stop)
    options = LiveOptions(config=TrackConfig(), start_s=4.0, record=tmp_path / "kept")
    summary, said = run(Again(open_recording(recording)), tmp_path / "out", stop, output, options)
    assert summary.count >= 30
    numbers = [frame.frame for frame in output.frames]
    assert numbers == sorted(set(numbers))
    assert np.mean([np.isfinite(frame.joints_m).all() for frame in output.frames]) > 0.9
    joints = read_joints(tmp_path / "out" / JOINTS_FILE)
    assert set(numbers) <= set(joints.frame.tolist())
    for frame in output.frames:
        row = int(np.flatnonzero(joints.frame == frame.frame)[0])
        np.testing.assert_allclose(joints.position_m[row], frame.joints_m, atol=2e-6)
    assert (tmp_path / "out" / "report.html").is_file()
    assert any("Tracking live" in sentence for sentence in said)
    kept = open_recording(tmp_path / "kept")
    assert set(joints.frame.tolist()) <= set(kept.streams[0].frame.tolist())


@pytest.mark.slow
def test_a_camera_that_is_lost_ends_the_run_in_order(recording, tmp_path):
    source = Again(open_recording(recording))
    source.lose_after = 400
    stop, options = Event(), LiveOptions(config=TrackConfig(), start_s=4.0)
    summary, _ = run(source, tmp_path / "out", stop, Collecting(9999, stop), options)
    assert summary.count > 0
    assert "check its cable" in (tmp_path / "out" / "run.json").read_text()


def test_without_images_nothing_is_written(tmp_path, recording):
    source = Again(open_recording(recording))
    source.lose_after = 0
    stop = Event()
    with pytest.raises(AnchorposeError, match="check its cable"):
        run(source, tmp_path / "out", stop, Collecting(1, stop))
    assert list(tmp_path.iterdir()) == []


def test_stopped_before_anybody_was_found_says_so_and_leaves_nothing(tmp_path, recording):
    stop = Event()
    threading.Timer(0.5, stop.set).start()
    with pytest.raises(AnchorposeError, match="Stopped before"):
        run(Again(open_recording(recording)), tmp_path / "out", stop, Collecting(1, stop))
    assert list(tmp_path.iterdir()) == []


def test_waiting_for_a_later_frame_is_a_look_ahead_of_two():
    config = TrackConfig()
    assert LiveOptions(config=config).live_config.follow == replace(config.follow, look_ahead=1)
    assert LiveOptions(config=config, wait_frames=1).live_config.follow == replace(config.follow, look_ahead=2)
