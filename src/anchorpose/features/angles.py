"""The angle of a vector in the plane, without a branch, so that eight of them are worked out at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

# arctan(t) / t over t^2, interpolated at Chebyshev's nodes: right to 1e-7 rad in single precision
_A0, _A1, _A2, _A3 = (np.float32(a) for a in (0.999999982, -0.333330367, 0.19991872, -0.141977978))
_A4, _A5, _A6, _A7 = (np.float32(a) for a in (0.106183706, -0.0745685481, 0.0421376235, -0.015731249))
_A8 = np.float32(0.00276628348)
ZERO: Any
ONE: Any
ZERO, ONE = np.float32(0.0), np.float32(1.0)  # a literal would make everything float64
PI, HALF_PI = np.float32(np.pi), np.float32(np.pi / 2)


@njit(cache=True, error_model="numpy")
def angle_of(y: Any, x: Any) -> Any:
    """The angle of (x, y) float32 from the x axis, radians from -pi to pi; 0 for the vector of no length."""
    along, across = abs(x), abs(y)
    steep = across > along
    longer = across if steep else along
    shorter = along if steep else across
    t = shorter / (longer if longer > ZERO else ONE)
    s = t * t
    high = _A4 + s * (_A5 + s * (_A6 + s * (_A7 + s * _A8)))
    angle = t * (_A0 + s * (_A1 + s * (_A2 + s * (_A3 + s * high))))
    angle = HALF_PI - angle if steep else angle
    angle = PI - angle if x < ZERO else angle
    return -angle if y < ZERO else angle
