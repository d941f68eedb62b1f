"""Two directions that span the tangent plane of a normal, for kernels that turn them afterwards."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def tangent_frame(normal: np.ndarray, frame: np.ndarray) -> bool:
    """Fills frame (3, 3) float64 with two unit tangents and the unit normal, right-handed; False where it is NaN or 0.

    The tangents hang on the world's axes: whoever uses them must not let that show in a result.
    """
    x, y, z = np.float64(normal[0]), np.float64(normal[1]), np.float64(normal[2])
    size = np.sqrt(x * x + y * y + z * z)
    if not size > 0.0:
        return False
    x, y, z = x / size, y / size, z / size
    frame[2, 0], frame[2, 1], frame[2, 2] = x, y, z
    if abs(x) < abs(y) and abs(x) < abs(z):
        across = np.sqrt(y * y + z * z)
        frame[0, 0], frame[0, 1], frame[0, 2] = 0.0, -z / across, y / across
    elif abs(y) < abs(z):
        across = np.sqrt(x * x + z * z)
        frame[0, 0], frame[0, 1], frame[0, 2] = z / across, 0.0, -x / across
    else:
        across = np.sqrt(x * x + y * y)
        frame[0, 0], frame[0, 1], frame[0, 2] = -y / across, x / across, 0.0
    frame[1, 0] = y * frame[0, 2] - z * frame[0, 1]
    frame[1, 1] = z * frame[0, 0] - x * frame[0, 2]
    frame[1, 2] = x * frame[0, 1] - y * frame[0, 0]
    return True
