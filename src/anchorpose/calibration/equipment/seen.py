"""What the cameras that saw the equipment have in common: one floor, and a room that none sees through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from anchorpose.calibration.equipment.camera_agreement import agreement
from anchorpose.calibration.equipment.moved import MovedConfig
from anchorpose.calibration.equipment.pose import EquipmentPose, EquipmentPoseConfig
from anchorpose.calibration.equipment.refine import FloorPrior
from anchorpose.calibration.equipment.still import StillView
from anchorpose.camera import Camera, transform_points
from anchorpose.recording.recording import FrameSet


@dataclass(frozen=True, slots=True, kw_only=True)
class EquipmentWorldConfig:
    """All cameras together."""

    pose: EquipmentPoseConfig = field(default_factory=EquipmentPoseConfig)
    moved: MovedConfig = field(default_factory=MovedConfig)
    floor_sigma_m: float = 0.002  # of the floor all cameras see together
    floor_sigma_rad: float = 0.0009  # 0.05 degrees
    most_disagreement: float = 0.25  # of one camera's points, seen through by another
    least_lead: float = 0.15  # of disagreement, between the best of symmetric choices and the next
    least_compared: int = 300  # points

    def __post_init__(self) -> None:
        for name in ("floor_sigma_m", "floor_sigma_rad", "most_disagreement", "least_lead", "least_compared"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True, eq=False)
class SeenEquipment:
    """One camera without a pose: what it saw over time, and what was found in it."""

    index: int
    view: StillView
    frames_m: tuple[np.ndarray, ...]
    times_s: tuple[float, ...]
    pose: EquipmentPose


def disagreement(
    cameras: tuple[Camera, Camera], indices: tuple[int, int], sample_frames: Sequence[FrameSet], one: SeenEquipment,
    config: EquipmentWorldConfig,
) -> float | None:  # fmt: skip
    """Share of points that one of two cameras sees and the other sees through; None where too few can be compared."""
    pairs = [
        (here, there)
        for frame in sample_frames[:: max(1, len(sample_frames) // 6)]
        if (here := frame.depths_m[indices[0]]) is not None and (there := frame.depths_m[indices[1]]) is not None
    ]
    up = cameras[1].require_pose()[:3, :3] @ one.view.floor.up
    foot = transform_points(cameras[1].require_pose(), -one.view.floor.height_m * one.view.floor.up)
    floor_m = float(foot @ up / up[1])
    found = agreement(cameras, pairs, floor_m, (one.view.noise_per_m, one.view.noise_per_m))
    return found.through_share if found.tested >= config.least_compared else None


def common_floor(seen: Sequence[SeenEquipment], cameras: Sequence[Camera], config: EquipmentWorldConfig) -> FloorPrior:
    """The floor of Gamma_0 that the cameras see, each at the equipment: up and height are their means."""
    ups, heights = [], []
    for one in seen:
        T = cameras[one.index].require_pose()
        ups.append(T[:3, :3] @ one.view.floor.up)
        heights.append(T[:3, 3] @ ups[-1] - one.view.floor.height_m)
    up = np.mean(ups, axis=0)
    return FloorPrior(up / np.linalg.norm(up), float(np.mean(heights)), config.floor_sigma_m, config.floor_sigma_rad)
