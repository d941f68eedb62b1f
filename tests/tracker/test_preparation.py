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
from anchorpose.tracker.preparation import Settled, settle

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
