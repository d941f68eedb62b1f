"""Joints smoothed by what came before and after (Rauch, Tung and Striebel 1965, doi:10.2514/3.3166)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from anchorpose.results.lasting import changing_sigma, lasting_sigma

FIRST_SPEED_M_S: Final = 1.0  # standard deviations of what is not known before the first frame
FIRST_ACCELERATION_M_S2: Final = 10.0


def smooth_stretch(
    time_s: np.ndarray, position_m: np.ndarray, sigma_m: np.ndarray, jerk: float
) -> tuple[np.ndarray, np.ndarray]:
    """Position (n, 3) and sigma (n,) of one joint that is known in all frames, time_s (n,) rising in any steps.

    The acceleration is constant but for a random walk: it changes by ``jerk`` times the square root of the time. Only
    the part of sigma that comes and goes is smoothed away; what lasts is added again, so sigma never falls below that.
    """
    course, variance = _smooth(np.diff(time_s), np.ascontiguousarray(position_m), changing_sigma(sigma_m) ** 2, jerk)
    return course, np.sqrt(np.maximum(variance, 0.0) + lasting_sigma(sigma_m) ** 2)


@njit(cache=True)
def _smooth(
    steps_s: np.ndarray, position_m: np.ndarray, variance: np.ndarray, jerk: float
) -> tuple[np.ndarray, np.ndarray]:
    """Position (n, 3) and its variance an axis (n,); rows of the state are position, speed and acceleration."""
    count = len(position_m)
    mean, spread = np.zeros((count, 3, 3)), np.zeros((count, 3, 3))  # after each frame
    ahead, wide = np.zeros((count, 3, 3)), np.zeros((count, 3, 3))  # as predicted from the frame before
    mean[0, 0] = position_m[0]
    spread[0, 0, 0] = variance[0]
    spread[0, 1, 1], spread[0, 2, 2] = FIRST_SPEED_M_S**2, FIRST_ACCELERATION_M_S2**2
    for k in range(1, count):
        motion = _motion(steps_s[k - 1])
        ahead[k] = _times(motion, mean[k - 1])
        wide[k] = _times(_times(motion, spread[k - 1]), motion.T) + jerk**2 * _random_walk(steps_s[k - 1])
        gain = wide[k, :, 0] / (wide[k, 0, 0] + variance[k])
        for row in range(3):
            mean[k, row] = ahead[k, row] + gain[row] * (position_m[k] - ahead[k, 0])
            spread[k, row] = wide[k, row] - gain[row] * wide[k, 0]
    for k in range(count - 2, -1, -1):
        back = _times(_times(spread[k], _motion(steps_s[k]).T), _inverse(wide[k + 1]))
        mean[k] += _times(back, mean[k + 1] - ahead[k + 1])
        spread[k] += _times(_times(back, spread[k + 1] - wide[k + 1]), back.T)
    return mean[:, 0].copy(), spread[:, 0, 0].copy()


@njit(cache=True)
def _motion(step_s: float) -> np.ndarray:
    return np.array([[1.0, step_s, 0.5 * step_s**2], [0.0, 1.0, step_s], [0.0, 0.0, 1.0]])


@njit(cache=True)
def _random_walk(step_s: float) -> np.ndarray:
    """(3, 3) covariance that position, speed and acceleration gain in a step, for a jerk of one."""
    h = step_s
    return np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]])


@njit(cache=True)
def _times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The product of two (3, 3); written out, since numba takes half a minute to compile that of any size."""
    product = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            product[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return product


@njit(cache=True)
def _inverse(a: np.ndarray) -> np.ndarray:
    """Of a (3, 3), by its cofactors."""
    inverse = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            p, q, r, s = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            inverse[i, j] = a[p, r] * a[q, s] - a[p, s] * a[q, r]
    determinant = a[0, 0] * inverse[0, 0] + a[0, 1] * inverse[1, 0] + a[0, 2] * inverse[2, 0]
    return inverse / determinant
