"""Recording from a source: the empty room first, then every image."""

import shutil
import time
from dataclasses import replace
from threading import Event

import numpy as np
import pytest
from live_builder import Again

from anchorpose.errors import AnchorposeError
from anchorpose.live import recorder
from anchorpose.live.cameras import Playback
from anchorpose.live.record import median_reading, record_live
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("record")
    simulate_recording(folder / "out", single(6, seconds=1.0, fps=10.0))
    return open_recording(folder / "out/recording")


def test_a_recording_that_is_played_and_recorded_is_the_same(recording, tmp_path):
    found = open_recording(record_live([Playback(recording)], tmp_path / "again", None, 0.0, print, Event()))
    assert found.streams[0].frame.tolist() == recording.streams[0].frame.tolist()
    assert found.streams[0].time_s == pytest.approx(recording.streams[0].time_s, abs=1e-6)
    for k in range(len(found.streams[0].files)):
        np.testing.assert_array_equal(read_frame(found, k).depths_m[0], read_frame(recording, k).depths_m[0])
    np.testing.assert_array_equal(found.backgrounds_m[0], recording.backgrounds_m[0])


def test_the_empty_room_is_the_median_of_readings_and_has_none_where_they_are_rare():
    images = np.array([[[1000, 0, 0]], [[1010, 0, 2000]], [[3000, 5, 2002]], [[1004, 0, 0]]], np.uint16)
    assert median_reading(images).tolist() == [[1010, 0, 2002]]


def test_the_room_is_looked_at_before_anything_is_recorded(recording, tmp_path):
    found = open_recording(record_live([Playback(recording)], tmp_path / "again", None, 0.45, print, Event()))
    assert found.backgrounds_m[0] is not None
    assert 1 <= len(found.streams[0].files) < len(recording.streams[0].files)


class Fails(Playback):
    """A source whose camera is unplugged at once."""

    def images(self, stop):
        raise AnchorposeError("no image came for 5 s; check its cable")
        yield


def test_a_failure_is_reported_once_while_the_other_camera_goes_on(recording, tmp_path):
    said, stop, began_s = [], Event(), time.monotonic()

    def say(sentence):
        said.append(sentence)
        if "check its cable" in sentence:
            stop.set()

    other = Again(recording, fps=10.0)
    fails = Fails(recording)
    fails.cameras = (replace(other.cameras[0], camera=replace(other.cameras[0].camera, name="second")),)
    other.about = fails.about = None
    found = open_recording(record_live([other, fails], tmp_path / "again", 20.0, 0.0, say, stop))
    assert time.monotonic() - began_s < 10.0
    for sentences in (said, found.notes):
        assert sum("check its cable" in sentence for sentence in sentences) == 1


def test_a_nearly_full_disk_ends_the_recording_at_once(recording, tmp_path, monkeypatch):
    monkeypatch.setattr(recorder, "ROOM_EVERY", 2)
    monkeypatch.setattr(recorder, "LEAST_FREE_BYTES", shutil.disk_usage(tmp_path).total * 2)
    began_s = time.monotonic()
    found = open_recording(record_live([Again(recording, fps=10.0)], tmp_path / "again", 20.0, 0.0, print, Event()))
    assert time.monotonic() - began_s < 10.0
    assert len(found.streams[0].files) == 2
    assert sum("nearly full" in note for note in found.notes) == 1


def test_a_source_without_images_leaves_no_recording(recording, tmp_path):
    silent = Playback(recording)
    silent.images = lambda stop: iter(())
    with pytest.raises(AnchorposeError, match="No camera gave"):
        record_live([silent], tmp_path / "again", None, 0.0, print, Event())
    assert not (tmp_path / "again" / "recording.json").exists()
