"""Equipment that is moved during the session: noticed on the sampled frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from anchorpose.calibration.equipment.pose import (
    Equipment,
    EquipmentPose,
    EquipmentPoseConfig,
    angle_between,
    find_equipment,
    refit,
)
from anchorpose.calibration.equipment.refine import FloorPrior
from anchorpose.calibration.equipment.still import StillView, what_stays
from anchorpose.camera import transform_points


@dataclass(frozen=True, slots=True, kw_only=True)
class MovedConfig:
    """What counts as moved."""

    late_share: float = 0.34  # of the sampled frames, at the end: where the equipment is looked at again
    least_frames: int = 3
    least_shift_m: float = 0.008  # twice the accuracy asked of a calibration
    least_turn_rad: float = 0.0105  # 0.6 degrees
    sigmas: float = 5.0
    doubt_share: float = 0.2  # of what is not hidden, seen through: worth a search of the whole floor
    gone_share: float = 0.4  # of what is not hidden, seen through: it is not there
    least_pixels: int = 100  # of a frame that show the equipment or what is behind it

    def __post_init__(self) -> None:
        for entry in fields(self):
            if not getattr(self, entry.name) > 0:
                raise ValueError(f"{entry.name} must be positive, got {getattr(self, entry.name)}")


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """first: index of the first frame that shows it elsewhere; T_camera_model: where it is then, None where that could
    not be found; shift_m, turn_rad: by how much, None likewise."""

    first: int
    T_camera_model: np.ndarray | None
    shift_m: float | None
    turn_rad: float | None


def notice_movement(
    view: StillView,
    frames_m: Sequence[np.ndarray],
    T_camera_model: np.ndarray,
    equipment: Equipment,
    prior: FloorPrior,
    pose_config: EquipmentPoseConfig,
    config: MovedConfig,
) -> Moved | None:
    """Whether the equipment is elsewhere in the last of ``frames_m``, in the order of time; None where it is not.

    view: the camera's noise and floor. A shift within a bar's width shows by fitting anew; a larger one by seeing
    through the places where the equipment was.
    """
    count = round(config.late_share * len(frames_m))
    if count < config.least_frames:
        return None
    late = np.stack(frames_m[-count:])
    late_view = replace(view, frames_m=late, still_m=what_stays(late, view.noise_per_m))
    now = refit(late_view, equipment, T_camera_model, prior, pose_config)
    if not isinstance(now, EquipmentPose):
        through = _through_share(late, view, T_camera_model, equipment, pose_config, config)
        if through < config.doubt_share:
            return None
        now = find_equipment(late_view, equipment, pose_config)
        if not isinstance(now, EquipmentPose) and through < config.gone_share:
            return None
    if not isinstance(now, EquipmentPose):
        return Moved(_first_gone(frames_m, view, T_camera_model, equipment, pose_config, config), None, None, None)
    centre, T_now = equipment.samples.centre_m, _same_turn(now.fit.T_camera_model, T_camera_model, equipment)
    shift = float(np.linalg.norm(transform_points(T_now, centre) - transform_points(T_camera_model, centre)))
    turn = angle_between(T_now, T_camera_model)
    far = shift > max(config.least_shift_m, config.sigmas * now.sigma_m)
    turned = turn > max(config.least_turn_rad, config.sigmas * now.sigma_rad)
    if not far and not turned:
        return None
    first = _first_elsewhere(frames_m, view, T_camera_model, T_now, equipment, pose_config)
    return Moved(first, T_now, shift, turn)


def _same_turn(T_now: np.ndarray, T_before: np.ndarray, equipment: Equipment) -> np.ndarray:
    """Of the poses that chi_0's symmetry makes the same, the one nearest to the earlier pose."""
    choices = [T_now, *(T_now @ turn for turn in equipment.symmetry.same)]
    return min(choices, key=lambda T: angle_between(T, T_before))


def _counts(
    frame_m: np.ndarray, view: StillView, T: np.ndarray, equipment: Equipment, config: EquipmentPoseConfig
) -> tuple[int, int]:
    """Pixels of one frame on the equipment at a pose, and those that see through it."""
    rendering = equipment.caster.render(view.camera, T)
    if rendering is None:
        return 0, 0
    expected, seen = rendering.depth_m, frame_m[rendering.window]
    there = np.isfinite(expected) & (seen > 0)
    gate = config.verdict.tolerance_m + config.refine.noise_gate * view.noise_per_m * np.where(there, expected, 0) ** 2
    off = np.where(there, seen - np.where(there, expected, 0.0), np.nan)
    return int(np.count_nonzero(np.abs(off) < gate)), int(np.count_nonzero(off > gate))


def _through_share(
    frames_m: np.ndarray, view: StillView, T: np.ndarray, equipment: Equipment, pose_config: EquipmentPoseConfig,
    config: MovedConfig,
) -> float:  # fmt: skip
    counts = np.array([_counts(frame, view, T, equipment, pose_config) for frame in frames_m]).sum(axis=0)
    return float(counts[1] / counts.sum()) if counts.sum() >= config.least_pixels else 0.0


def _first_gone(
    frames_m: Sequence[np.ndarray], view: StillView, T: np.ndarray, equipment: Equipment,
    pose_config: EquipmentPoseConfig, config: MovedConfig,
) -> int:  # fmt: skip
    """The frame after the last one that shows the equipment in its place."""
    for index in range(len(frames_m) - 1, -1, -1):
        on, through = _counts(frames_m[index], view, T, equipment, pose_config)
        if on + through >= config.least_pixels and through < config.gone_share * (on + through):
            return min(index + 1, len(frames_m) - 1)
    return 0


def _first_elsewhere(
    frames_m: Sequence[np.ndarray], view: StillView, T_before: np.ndarray, T_now: np.ndarray, equipment: Equipment,
    config: EquipmentPoseConfig,
) -> int:  # fmt: skip
    """The start of the best split in time: earlier frames fit the earlier pose, later ones the later."""
    gain = []
    for frame in frames_m:
        on_before, through_before = _counts(frame, view, T_before, equipment, config)
        on_now, through_now = _counts(frame, view, T_now, equipment, config)
        gain.append((on_now - through_now) - (on_before - through_before))
    later = np.append(np.cumsum(np.array(gain, dtype=np.float64)[::-1])[::-1], 0.0)
    return int(np.argmax(later))
