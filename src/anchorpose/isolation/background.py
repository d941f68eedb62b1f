"""The empty room as each camera sees it, and what stands in front of it (paper, Section III)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
from numba import njit

from anchorpose.isolation.components import JumpLimit, jump_limit, without_flying_pixels
from anchorpose.isolation.config import IsolationConfig


class BackgroundSource(StrEnum):
    """Where the background came from; people read it in the run's notes."""

    PICTURE = "the given picture of the empty room"
    RECORDING = "what stays in place in the recording"
    REMOVED = "the recording holds people only"


@dataclass(frozen=True, slots=True, eq=False)
class BackgroundModel:
    """One camera's empty room.

    depth_m (height, width) float32 metres, 0 = nothing known. sigma_m (height, width) float32: deviation of a live
    reading from depth_m where nobody stands. noise_per_m: the sensor's own law sigma = noise_per_m z^2.
    """

    depth_m: np.ndarray
    sigma_m: np.ndarray
    noise_per_m: float
    focal_px: float
    source: BackgroundSource

    def jump_limit(self, config: IsolationConfig) -> JumpLimit:
        """How far neighbours on one surface may differ in this camera's pictures."""
        return jump_limit(self.noise_per_m, self.focal_px, config.jump_gate, config.steepest_slope_rad)


def foreground(depth_m: np.ndarray, model: BackgroundModel, config: IsolationConfig) -> np.ndarray:
    """(height, width) bool: pixels nearer than the room by more than the noise explains, flying pixels left out.

    The test is on the 3x3 median of the difference in sigmas, so it reaches down to a sole on the floor: the margin is
    two sigmas along the ray, at grazing incidence a centimetre of height. A pixel that is nearer beyond doubt needs no
    such company: fingers and corners of the outline are smaller than the median. Where the background is unknown, a
    reading counts as foreground; what hangs together with nobody is sorted out later.
    """
    nearer = _sigmas_nearer(depth_m, model.depth_m, model.sigma_m)
    mask = ((cv2.medianBlur(nearer, 3) > config.background_gate) & (nearer > 0)) | (nearer > config.jump_gate)
    return without_flying_pixels(depth_m, mask, model.jump_limit(config))


@njit(cache=True)
def _sigmas_nearer(depth: np.ndarray, room: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """How many sigmas each reading is before the room; 1e3 where the room is unknown, -1e3 without a reading."""
    nearer = np.empty_like(depth)
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            if depth[row, column] <= 0:
                nearer[row, column] = -1e3
            elif room[row, column] <= 0:
                nearer[row, column] = 1e3
            else:
                nearer[row, column] = (room[row, column] - depth[row, column]) / sigma[row, column]
    return nearer
