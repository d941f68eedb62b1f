"""What is settled before tracking: a picture of the empty room from before the camera moved is not used."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from room_builder import FRONT, ROOM, body, picture, write_room_recording
from scipy.spatial.transform import Rotation

from anchorpose.camera import Camera
from anchorpose.recording.reader import open_recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.preparation import Settled, _without_outdated_rooms, settle

WALK = [picture(FRONT, *ROOM, *body(0.0, z), seed=k) for k, z in enumerate(np.linspace(-1.0, 1.0, 8))]


def settled(folder: Path, camera: Camera) -> Settled:
    """Settle a recording whose empty room was recorded with another pose of the camera."""
    folder = write_room_recording(folder, FRONT, picture(camera, *ROOM, seed=99), WALK)
    return settle(open_recording(folder), TrackConfig())


@pytest.mark.parametrize("turn_deg", [0.5, -0.5])
def test_a_picture_from_before_the_camera_moved_is_not_used_and_this_is_noted(tmp_path: Path, turn_deg: float) -> None:
    pose = FRONT.require_pose().copy()
    pose[:3, :3] @= Rotation.from_euler("x", turn_deg, degrees=True).as_matrix()
    found = settled(tmp_path / "moved", replace(FRONT, T_world_camera=pose))
    assert found.recording.backgrounds_m == (None,)
    (note,) = [note for note in found.calibration.notes if "has moved" in note]
    assert "camera front" in note
    assert "record the empty room again" in note


def test_a_picture_of_the_same_room_is_used(tmp_path: Path) -> None:
    found = settled(tmp_path / "still", FRONT)
    assert found.recording.backgrounds_m[0] is not None
    assert not [note for note in found.calibration.notes if "has moved" in note]


def test_cameras_whose_clocks_have_different_epochs_are_settled_with_a_picture_of_the_room(tmp_path: Path) -> None:
    """The pictures of the room are compared with each camera's own images, before the clocks are known."""
    folder = write_room_recording(tmp_path / "r", FRONT, picture(FRONT, *ROOM, seed=99), WALK)
    recording = open_recording(folder)
    later = replace(recording.streams[0], time_s=recording.streams[0].time_s + 5000.0)
    second = replace(recording.cameras[0], name="second")
    both = replace(
        recording,
        cameras=(recording.cameras[0], second),
        streams=(recording.streams[0], later),
        backgrounds_m=recording.backgrounds_m * 2,
    )
    found, notes = _without_outdated_rooms(both, TrackConfig())
    assert notes == ()
    assert all(room is not None for room in found.backgrounds_m)
