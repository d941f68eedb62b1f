"""Cameras are matched by name where a recording has more or fewer of them than the room that was learnt."""

from types import SimpleNamespace

import pytest
from recording_builder import write_recording

from anchorpose.errors import InputError
from anchorpose.live.first_seconds import Prepared, in_room
from anchorpose.live.stored import LivePatient, write_patients
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import Clock
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.room import NO_REVIEW, Room, Run


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
    later = write_recording(tmp_path / "later", cameras=("back",))
    with pytest.raises(InputError, match="has no usable image of camera left; check its cable"):
        in_room(later, room)


def test_results_of_a_session_whose_recording_lacks_a_camera_are_written_with_a_note(tmp_path, monkeypatch):
    first, later = (
        write_recording(tmp_path / name, cameras=cameras)
        for name, cameras in (("first", ("back", "left")), ("later", ("back",)))
    )
    recording, clocks = open_recording(first), SimpleNamespace(clocks=(Clock(), Clock()))
    room = Room(recording, clocks, None, (), (), NO_REVIEW)
    prepared, written = Prepared(None, Run(room, TrackConfig()), None), []
    monkeypatch.setattr("anchorpose.live.stored.write_results", lambda *given: written.append(given))
    blocks = SimpleNamespace(read=lambda: iter(()))
    write_patients(tmp_path / "results", [LivePatient(1, prepared, blocks)], later, ["tracked live"])
    used = written[0][2].room
    assert used.recording is recording
    assert used.notes[1].startswith("pictures are only made from the first seconds: ")
    assert used.notes[1].endswith("uncover its lens")
