"""What the cameras that saw the equipment have in common: one floor, and a room that none sees through.

Whether two cameras' poses agree: neither may see through what the other sees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from anchorpose.calibration.equipment.moved import MovedConfig
from anchorpose.calibration.equipment.pose import EquipmentPose, EquipmentPoseConfig
from anchorpose.calibration.equipment.refine import FloorPrior
from anchorpose.calibration.equipment.still import StillView
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.recording.recording import FrameSet

APART_M: Final = 0.20  # people move between two cameras' pictures, surfaces are rough
NOISE_GATE: Final = 4.0
POINTS: Final = 3000  # of each picture
ABOVE_FLOOR_M: Final = 0.15  # the floor agrees whichever way a camera looks


@dataclass(frozen=True, slots=True)
class Agreement:
    """tested: points of one camera that are not hidden from the other; through: those that it sees through."""

    tested: int
    through: int

    @property
    def through_share(self) -> float:
        return self.through / max(self.tested, 1)


def agreement(
    cameras: tuple[Camera, Camera],
    depths_m: Sequence[tuple[np.ndarray, np.ndarray]],
    floor_height_m: float,
    noise_per_m: tuple[float, float],
) -> Agreement:
    """Both ways, over pairs of pictures of about the same moment.

    cameras: both with a pose; depths_m: pictures (height, width) of the first and the second, 0 = no reading.
    """
    tested = through = 0
    for pair in depths_m:
        for here, there in ((0, 1), (1, 0)):
            depth, other = pair[here], cameras[there]
            step = max(1, int(np.sqrt(depth.size / POINTS)))
            points = cameras[here].back_project(depth)[::step, ::step].reshape(-1, 3)
            points = points[np.isfinite(points[:, 2])].astype(np.float64)
            world = transform_points(cameras[here].require_pose(), points)
            world = world[world[:, 1] > floor_height_m + ABOVE_FLOOR_M]
            seen = transform_points(invert_rigid(other.require_pose()), world)
            column, row, inside = other.pixel_of(seen)
            reading, z = pair[there][row, column], seen[:, 2]
            margin = APART_M + NOISE_GATE * max(noise_per_m) * np.square(z)
            usable = inside & (reading > 0) & (z > 0)
            tested += int(np.count_nonzero(usable & (reading > z - margin)))
            through += int(np.count_nonzero(usable & (reading > z + margin)))
    return Agreement(tested, through)


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
