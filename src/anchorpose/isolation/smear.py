"""Depth edges that a camera's own filters have drawn out into ramps, measured and left out.

Spatial filters (librealsense's among them) join a person and the wall behind by a slope of a decimetre in width: no
surface is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

WIDEST_PX: Final = 16  # an edge that is wider is a slanting surface
JUMP_M: Final = 0.40  # from one side to the other: clothes, arms and seats differ from what is behind them by less
FLAT: Final = 0.1  # of the jump: how even the four pixels on either side of an edge are
MIDDLE: Final = (0.2, 0.8)  # of the jump: the ramp's middle, whose width is measured
LEAST_EDGES: Final = 1000  # in all frames together; real recordings have tens of thousands
SHARP_PX: Final = 2.0  # the middle of an edge of an unfiltered camera has one pixel or none
FRAMES: Final = 8  # that are measured
ON_RAMP: Final = 0.15  # of the jump, from either side


def smear_px(frames_m: Sequence[np.ndarray]) -> int:
    """How many pixels wide this camera's depth edges are; 0 where they are sharp, or too few to tell.

    frames_m: (height, width) float32 metres, 0 = no reading.
    """
    chosen = frames_m[:: max(1, len(frames_m) // FRAMES)]
    middles = np.concatenate([_middles(depth) for frame in chosen for depth in (frame, frame.T)])
    if len(middles) < LEAST_EDGES:
        return 0
    middle = float(np.median(middles))
    return 0 if middle <= SHARP_PX else int(np.ceil(middle / (MIDDLE[1] - MIDDLE[0])))


def _middles(depth_m: np.ndarray) -> np.ndarray:
    """(e,) pixels in the middle of each ramp along the rows: between two even sides that differ by a jump."""
    beside, width = 4, depth_m.shape[1]
    span = width - WIDEST_PX - 2 * beside
    if span <= 0:
        return np.zeros(0, np.int64)
    places = [depth_m[:, k : k + span] for k in (0, beside, beside + WIDEST_PX, WIDEST_PX + 2 * beside)]
    jump = np.abs(places[2] - places[1])
    even = (np.abs(places[1] - places[0]) < FLAT * jump) & (np.abs(places[3] - places[2]) < FLAT * jump)
    row, column = np.nonzero((jump > JUMP_M) & even)
    ramp = depth_m[row[:, None], column[:, None] + np.arange(WIDEST_PX + 2 * beside + 1)]
    ramp = ramp[(ramp > 0).all(axis=1), beside : beside + WIDEST_PX + 1]
    ends = np.sort(ramp[:, [0, -1]], axis=1)
    share = (ramp - ends[:, :1]) / np.maximum(np.diff(ends, axis=1), 1e-6)
    return np.asarray(((share > MIDDLE[0]) & (share < MIDDLE[1])).sum(axis=1))


def smeared(depth_m: np.ndarray, width_px: int) -> np.ndarray:
    """(height, width) bool: pixels on a ramp between two surfaces that differ by a jump; width_px: ``smear_px``."""
    square = np.ones((2 * width_px + 1, 2 * width_px + 1), np.uint8)
    seen = depth_m > 0
    near = cv2.erode(np.where(seen, depth_m, np.float32(1e3)), square)
    far = cv2.dilate(depth_m, square)
    jump = far - near
    return np.asarray(seen & (jump > JUMP_M) & (depth_m > near + ON_RAMP * jump) & (depth_m < far - ON_RAMP * jump))
