"""Cameras are matched by name where a recording has more or fewer of them than the room that was learnt."""

from types import SimpleNamespace

import pytest
from recording_builder import write_recording

from anchorpose.errors import InputError
from anchorpose.live.first_seconds import in_room
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import Clock


def room_of(folder, clocks):
    return SimpleNamespace(recording=open_recording(folder), clocks=SimpleNamespace(clocks=clocks))


def test_a_recording_with_a_camera_that_the_room_lacks_is_read_without_it(tmp_path):
    room = room_of(write_recording(tmp_path / "first", cameras=("back", "left")), (Clock(), Clock(ahead_s=0.5)))
    found = in_room(write_recording(tmp_path / "all", cameras=("front", "left", "back")), room)
    assert [camera.name for camera in found.cameras] == ["back", "left"]
    assert [stream.files.folder.parent.name for stream in found.streams] == ["back", "left"]
    assert found.streams[1].time_s[0] == pytest.approx(-0.5)


def test_a_recording_without_a_camera_of_the_room_is_refused_by_its_name(tmp_path):
    room = room_of(write_recording(tmp_path / "first", cameras=("back", "left")), (Clock(), Clock()))
    with pytest.raises(InputError, match="has no usable image of camera left; check its cable"):
        in_room(write_recording(tmp_path / "later", cameras=("back",)), room)
