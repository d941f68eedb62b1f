"""Given poses against what is seen: equipment that stands elsewhere than they say, or that is moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from anchorpose.calibration.equipment.moved import notice_movement
from anchorpose.calibration.equipment.pose import Equipment, prepare_equipment
from anchorpose.calibration.equipment.refine import FloorPrior
from anchorpose.calibration.equipment.seen import EquipmentWorldConfig
from anchorpose.calibration.equipment.still import StillView, see_still
from anchorpose.calibration.equipment.world import moved_note
from anchorpose.calibration.floor import FloorConfig, NoFloor, find_floor
from anchorpose.calibration.noise import noise_per_m
from anchorpose.camera import invert_rigid
from anchorpose.recording.recording import FrameSet, Recording


def watch_given_poses(
    recording: Recording,
    sample_frames: Sequence[FrameSet],
    floor_config: FloorConfig,
    floor_height_m: float | None,
    config: EquipmentWorldConfig,
) -> list[str]:
    """Notes on cameras whose given pose puts the equipment where it is not seen; given poses are used all the same."""
    if recording.equipment is None or floor_height_m is None:
        return []
    equipment = prepare_equipment(recording.equipment)
    notes = []
    for index in range(len(recording.cameras)):
        notes += _watch_one(recording, index, sample_frames, equipment, floor_config, floor_height_m, config)
    return notes


def _watch_one(
    recording: Recording, index: int, sample_frames: Sequence[FrameSet], equipment: Equipment,
    floor_config: FloorConfig, floor_height_m: float, config: EquipmentWorldConfig,
) -> list[str]:  # fmt: skip
    pairs = [(frame.time_s, depth) for frame in sample_frames if (depth := frame.depths_m[index]) is not None]
    view = _view(recording, index, [depth for _, depth in pairs], floor_config)
    if view is None:
        return []
    camera = recording.cameras[index]
    refine = config.pose.refine
    prior = FloorPrior(np.array([0.0, 1.0, 0.0]), floor_height_m, refine.standing_sigma_m, refine.standing_sigma_rad)
    moved = notice_movement(
        view, [depth for _, depth in pairs], invert_rigid(camera.require_pose()), equipment, prior, config.pose,
        config.moved,
    )  # fmt: skip
    if moved is None:
        return []
    if moved.first > 0:
        return [moved_note(camera.name, moved, [time for time, _ in pairs])]
    if moved.shift_m is None or moved.turn_rad is None:
        return [f"the given pose of camera {camera.name} puts the equipment where this camera sees through it"]
    return [
        f"the given pose of camera {camera.name} puts the equipment {1000 * moved.shift_m:.0f} mm and "
        f"{np.degrees(moved.turn_rad):.1f} degrees from where this camera sees it; the given pose is used"
    ]


def _view(
    recording: Recording, index: int, frames_m: Sequence[np.ndarray], floor_config: FloorConfig
) -> StillView | None:
    """What this camera sees over time; None where it sees no floor or nothing at all."""
    if not frames_m:
        return None
    try:
        noise = noise_per_m(frames_m)
    except ValueError:
        return None
    camera = replace(recording.cameras[index], T_world_camera=None)
    still = recording.backgrounds_m[index]
    floor = find_floor(
        still if still is not None else np.median(np.stack(frames_m), axis=0), camera, noise, floor_config
    )
    return None if isinstance(floor, NoFloor) else see_still(camera, frames_m, still, noise, floor)
