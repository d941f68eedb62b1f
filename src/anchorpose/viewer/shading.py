"""How light a pixel is drawn, by the slope of the skin there: points without any shading look like paper cut-outs."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.camera import Camera

REACH_PX: Final = 4  # slopes over nine pixels, 5 cm at 2 m: over fewer, the sensor's noise is what would be seen
JUMP_M: Final = 0.15  # more than that between them is another surface, and no slope

_LIGHT: Final = np.array(
    [0.35, -0.5, -0.79]
)  # camera frame: from above, a little from the side, mostly from the camera


def shade(depth_m: np.ndarray, camera: Camera) -> np.ndarray:
    """(height, width) uint8, 255 = facing the light; for the eye only, nothing is measured with it.

    depth_m (height, width) metres, 0 = no reading. The slope is 0 where a neighbour is missing or on another surface.
    """
    z = np.maximum(depth_m, 0.1)
    across = _slope(depth_m, 1) * (camera.intrinsics.fx / (2 * REACH_PX)) / z
    down = _slope(depth_m, 0) * (camera.intrinsics.fy / (2 * REACH_PX)) / z
    facing = (across * _LIGHT[0] + down * _LIGHT[1] - _LIGHT[2]) / np.sqrt(1.0 + across**2 + down**2)
    return np.asarray(255.0 * np.clip(facing, 0.0, 1.0)).astype(np.uint8)


def _slope(depth_m: np.ndarray, axis: int) -> np.ndarray:
    """The change of depth over ``2 * REACH_PX`` pixels along an axis; 0 where it cannot be told."""
    before, after = np.roll(depth_m, REACH_PX, axis), np.roll(depth_m, -REACH_PX, axis)
    change = after - before
    known = (before > 0) & (after > 0) & (np.abs(change) < JUMP_M)
    edge = [slice(None), slice(None)]
    for edge[axis] in (slice(None, REACH_PX), slice(-REACH_PX, None)):
        known[tuple(edge)] = False
    return np.where(known, change, np.float32(0.0))
