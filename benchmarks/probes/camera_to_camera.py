"""Measure how well cameras are placed without poses or equipment, from the floor and people seen by several cameras."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from probe import Row, Scene, answer

from anchorpose.calibration.camera_to_camera import CameraToCamera, PlacingConfig, place_cameras
from anchorpose.calibration.equipment_pose import angle_between
from anchorpose.calibration.first_frames import FloorPlane, find_floor, noise_per_m
from anchorpose.camera import invert_rigid
from anchorpose.recording.reader import open_recording, read_frames


def measure(scene: Scene) -> Iterator[Row]:
    """Place the cameras by the frames that ``track`` would use, and yield one row of errors."""
    recording, config = open_recording(scene.recording), PlacingConfig()
    frames = list(read_frames(recording))
    moments = [frames[k] for k in np.linspace(0, len(frames) - 1, config.moments).astype(int)]
    cameras = [replace(camera, T_world_camera=None) for camera in recording.cameras]
    rooms_m = [room for room in recording.backgrounds_m if room is not None]
    floors = [find_floor(room, camera, noise_per_m([room])) for room, camera in zip(rooms_m, cameras, strict=True)]
    known = [floor for floor in floors if isinstance(floor, FloorPlane)]
    found = place_cameras(cameras, known, rooms_m, moments, config) if len(known) == len(floors) else None
    if not isinstance(found, CameraToCamera):
        yield "", {"refused": 1.0}
        return
    T_first_world = invert_rigid(recording.cameras[0].require_pose())
    true = [T_first_world @ camera.require_pose() for camera in recording.cameras]
    off = [(T_found, T) for T_found, T in zip(found.T_first_camera, true, strict=True)][1:]
    shift_mm = [1e3 * float(np.linalg.norm(T_found[:3, 3] - T[:3, 3])) for T_found, T in off]
    turn_deg = [float(np.degrees(angle_between(T_found, T))) for T_found, T in off]
    yield "", {"camera_place_mm": max(shift_mm), "turn_deg": max(turn_deg)}


if __name__ == "__main__":
    answer(measure)
