"""calibration.json, the format ``camera-calibration``: poses of cameras, found once and used for many recordings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.document import check_format, read_json_object
from anchorpose.recording.format import parse_pose
from anchorpose.recording.recording import Recording

CALIBRATION_FORMAT: Final = "camera-calibration"
CALIBRATION_FILE: Final = "calibration.json"


def read_calibration(path: Path) -> dict[str, np.ndarray]:
    """T_world_camera (4, 4) by camera name; raises InputError naming the file, the key and the remedy."""
    top = read_json_object(path / CALIBRATION_FILE if path.is_dir() else path)
    top.only("format", "version", "recording", "cameras", "floor_height_m", "notes", "versions")
    check_format(top, CALIBRATION_FORMAT)
    poses: dict[str, np.ndarray] = {}
    for entry in top.objects("cameras"):
        name = entry.text("name")
        if name in poses:
            raise entry.refuse("name", f"'{name}' stands there twice", "keep one of the two")
        poses[name] = parse_pose(entry)
    return poses


def with_poses(recording: Recording, path: Path) -> Recording:
    """The recording with the poses of a calibration file instead of its own.

    Raises InputError where the file has no pose for one of its cameras: some old and some new poses make no world.
    """
    poses = read_calibration(path)
    missing = [camera.name for camera in recording.cameras if camera.name not in poses]
    if missing:
        remedy = "calibrate a recording of the same cameras, or leave this file out"
        raise InputError(path, f"has no pose for camera {', '.join(missing)}", remedy)
    cameras = tuple(replace(camera, T_world_camera=poses[camera.name]) for camera in recording.cameras)
    return replace(recording, cameras=cameras)
