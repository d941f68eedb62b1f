"""Measure the errors of the camera poses that are found from the equipment of one clinic.

The cameras are calibrated with the depth image of the empty room, without it (people are always in view), and with the
equipment.json of another clinic, which must be refused. A pose is wrong if it is off by more than 20 mm at the
equipment or 1 degree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from probe import Row, Scene, answer

from anchorpose.calibration.equipment_pose import angle_between
from anchorpose.camera import Camera, transform_points
from anchorpose.errors import InputError
from anchorpose.recording.reader import open_recording, read_frames
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.preparation import calibrate

WRONG_MM, WRONG_DEG = 20.0, 1.0


def measure(scene: Scene) -> Iterator[Row]:
    """Calibrate in every way."""
    recording = open_recording(scene.recording)
    true, frames = recording.cameras, list(read_frames(recording))
    given = replace(recording, cameras=tuple(replace(camera, T_world_camera=None) for camera in true))
    bare = replace(given, backgrounds_m=(None,) * len(true))
    other = draw_clinic(replace(scene.simulated, seed=scene.simulated.seed + 1000)).equipment
    yield "with the depth image of the empty room", _scores(given, frames, true)
    yield "without it: people always in view", _scores(bare, frames, true)
    yield "with another clinic's equipment.json", _scores(replace(given, equipment=other), frames, true)


def _scores(recording: Recording, frames: list[FrameSet], true: tuple[Camera, ...]) -> dict[str, float]:
    try:
        found = calibrate(recording, frames, TrackConfig()).cameras
    except InputError:
        return {"refused": 1.0}
    assert recording.equipment is not None
    vertices_m = recording.equipment.triangles()[0]
    middle_m = (vertices_m.min(axis=0) + vertices_m.max(axis=0)) / 2.0
    shift_mm, turn_deg, place_mm = np.array([_errors(*pair, middle_m) for pair in zip(found, true, strict=True)]).T
    return {
        "equipment_mm": shift_mm.mean(),
        "worst_camera_mm": shift_mm.max(),
        "turn_deg": turn_deg.mean(),
        "worst_camera_deg": turn_deg.max(),
        "camera_place_mm": place_mm.mean(),
        "wrong_accepted": float(shift_mm.max() > WRONG_MM or turn_deg.max() > WRONG_DEG),
    }


def _errors(found: Camera, true: Camera, middle_m: np.ndarray) -> tuple[float, float, float]:
    """Return the errors in mm at the equipment's middle, in degrees, and in mm at the camera's own place."""
    T_found, T_true = found.require_pose(), true.require_pose()
    shift_m = transform_points(T_found @ np.linalg.inv(T_true), middle_m) - middle_m
    place_m = found.position_m - true.position_m
    turn_rad = angle_between(T_found, T_true)
    return 1e3 * np.linalg.norm(shift_m), np.degrees(turn_rad), 1e3 * np.linalg.norm(place_m)


if __name__ == "__main__":
    answer(measure)
