"""Whether two cameras' poses agree: neither may see through what the other sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.camera import Camera, invert_rigid, transform_points

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
