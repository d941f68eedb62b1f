"""Depth images that a recorder turned or mirrored, put upright: pixels, lens and pose together, exactly."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.lens import Intrinsics, LensModel

QUARTERS: Final = {0: 0, 90: 1, 180: 2, 270: 3}
"""Quarter turns clockwise, as one sees the image, by degrees."""


def turn_image(grey: np.ndarray, degrees: int, mirror: bool) -> np.ndarray:
    """The image turned clockwise, then mirrored left to right; contiguous."""
    turned = np.rot90(grey, -QUARTERS[degrees])
    return np.ascontiguousarray(turned[:, ::-1] if mirror else turned)


def can_turn(lens: Intrinsics, degrees: int) -> bool:
    """Whether OpenCV's model can describe the turned lens: a sensor's tilt has an order of its axes, which a quarter
    turn would exchange."""
    return QUARTERS[degrees] % 2 == 0 or not any(lens.distortion[12:14])


def turn_lens(lens: Intrinsics, size: tuple[int, int], degrees: int, mirror: bool) -> Intrinsics:
    """The lens of the turned image; size: width and height before. See ``can_turn``."""
    width, height = size
    for _ in range(QUARTERS[degrees] % 2):
        lens = _quarter(lens, height)
        width, height = height, width
    if QUARTERS[degrees] >= 2:
        lens = _mirror_down(_mirror_across(lens, width), height)
    return _mirror_across(lens, width) if mirror else lens


def turn_pose(T_world_camera: np.ndarray, degrees: int) -> np.ndarray:
    """T_world_camera of the camera whose image was turned clockwise: the camera turned the other way about its axis."""
    angle = np.deg2rad(degrees)
    cos, sin = np.rint(np.cos(angle)), np.rint(np.sin(angle))
    T_turned_camera = np.eye(4)
    T_turned_camera[:2, :2] = [[cos, -sin], [sin, cos]]
    return np.asarray(T_world_camera @ T_turned_camera.T)


def _quarter(lens: Intrinsics, height: int) -> Intrinsics:
    """Clockwise by 90 degrees: what had been x becomes y, and y becomes -x."""
    d = list(lens.distortion)
    if lens.model is not LensModel.KANNALA_BRANDT:
        d[2], d[3] = d[3], -d[2]
        if len(d) >= 12:
            d[8:12] = [-d[10], -d[11], d[8], d[9]]
    return replace(lens, fx=lens.fy, fy=lens.fx, cx=height - 1 - lens.cy, cy=lens.cx, distortion=tuple(d))


def _mirror_across(lens: Intrinsics, width: int) -> Intrinsics:
    """Left to right: x becomes -x."""
    d = _negated(lens, (3, 8, 9, 13))  # p2, s1, s2 and the tilt about y
    return replace(lens, cx=width - 1 - lens.cx, distortion=d)


def _mirror_down(lens: Intrinsics, height: int) -> Intrinsics:
    """Top to bottom: y becomes -y."""
    d = _negated(lens, (2, 10, 11, 12))  # p1, s3, s4 and the tilt about x
    return replace(lens, cy=height - 1 - lens.cy, distortion=d)


def _negated(lens: Intrinsics, places: tuple[int, ...]) -> tuple[float, ...]:
    if lens.model is LensModel.KANNALA_BRANDT:
        return lens.distortion
    return tuple(-value if place in places and value else value for place, value in enumerate(lens.distortion))
