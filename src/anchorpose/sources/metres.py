"""Depth in metres as floating-point numbers, to grey values."""

from __future__ import annotations

from typing import Final

import numpy as np

GREY_M: Final = 0.00025
"""A grey value of depth that was in metres: 16 bits reach 16.4 m, and rounding adds an eighth of a millimetre, less
than any depth camera resolves."""

FARTHEST: Final = 65534  # 65535 stands for no reading in some formats


def to_grey(depth_m: np.ndarray) -> np.ndarray:
    """(height, width) metres to uint16 in steps of ``GREY_M``; 0 where there is no reading, and beyond 16.4 m."""
    steps = np.nan_to_num(np.asarray(depth_m, np.float64) / GREY_M, nan=0.0, posinf=0.0, neginf=0.0)
    steps[(steps < 0.5) | (steps > FARTHEST)] = 0.0
    return np.rint(steps).astype(np.uint16)
