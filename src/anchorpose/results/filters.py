"""Two smoothers of one joint's path, without delay: Kalman with Rauch, Tung and Striebel, and Butterworth.

Source: Rauch, Tung and Striebel 1965 (doi:10.2514/3.3166).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from scipy.signal import butter, sosfiltfilt

from anchorpose.results.uncertainty import random_sigma, systematic_sigma

FIRST_SPEED_M_S: Final = 1.0  # standard deviations of what is not known before the first frame
FIRST_ACCELERATION_M_S2: Final = 10.0


def smooth_stretch(
    time_s: np.ndarray, position_m: np.ndarray, sigma_m: np.ndarray, jerk: float
) -> tuple[np.ndarray, np.ndarray]:
    """Position (n, 3) and sigma (n,) of one joint that is known in all frames, time_s (n,) rising in any steps.

    The acceleration is a random walk: it changes by ``jerk`` times the square root of the time. Only the random part of
    sigma is smoothed away; the systematic part is added again, so sigma never falls below that.
    """
    course, variance = _smooth(np.diff(time_s), np.ascontiguousarray(position_m), random_sigma(sigma_m) ** 2, jerk)
    return course, np.sqrt(np.maximum(variance, 0.0) + systematic_sigma(sigma_m) ** 2)


@njit(cache=True)
def _smooth(
    steps_s: np.ndarray, position_m: np.ndarray, variance: np.ndarray, jerk: float
) -> tuple[np.ndarray, np.ndarray]:
    """Position (n, 3) and its variance along each axis (n,); the state's rows are position, speed and acceleration."""
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
    """The product of two (3, 3); written out, since numba takes half a minute to compile one of any size."""
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


_ORDER: Final = 2  # of one pass; forwards and backwards make it four
_TWICE: Final = (np.sqrt(2.0) - 1.0) ** 0.25
"""Both passes together are 3 dB down at this share of the cutoff of one, both as tangents, which is how digital filters
see frequencies (Winter, Biomechanics and Motor Control of Human Movement, on digital filtering)."""


def highest_cutoff_hz(rate_hz: float) -> float:
    """The cutoff must lie below this: nine tenths of half the rate."""
    return 0.45 * rate_hz


def shortest_frames(rate_hz: float, cutoff_hz: float) -> int:
    """Frames a stretch must have: two periods of the cutoff, and more than the filter's own padding."""
    return max(3 * (2 * _ORDER + 1) + 1, int(np.ceil(2.0 * rate_hz / cutoff_hz)))


def low_pass(values: np.ndarray, rate_hz: float, cutoff_hz: float) -> np.ndarray:
    """Values (n, ...) filtered along the first axis by a Butterworth of effective order four, zero lag.

    rate_hz: of the evenly spaced, finite values. cutoff_hz: where the two passes together are 3 dB down. Raises
    ValueError for a cutoff that is not below ``highest_cutoff_hz`` and for fewer than ``shortest_frames``.
    """
    if not 0.0 < cutoff_hz < highest_cutoff_hz(rate_hz):
        raise ValueError(f"a cutoff of {cutoff_hz:g} Hz does not fit {rate_hz:g} frames a second")
    if len(values) < shortest_frames(rate_hz, cutoff_hz):
        raise ValueError(f"{len(values)} frames are too few for a cutoff of {cutoff_hz:g} Hz")
    one_pass_hz = rate_hz / np.pi * np.arctan(np.tan(np.pi * cutoff_hz / rate_hz) / _TWICE)
    sections = butter(_ORDER, one_pass_hz, fs=rate_hz, output="sos")
    filtered: np.ndarray = sosfiltfilt(sections, values, axis=0)
    return filtered


MOST_UNEVEN: Final = 0.25
"""Of the usual step. The filter needs even steps; stamps that jitter more are refused rather than resampled."""


def evenness(time_s: np.ndarray) -> float:
    """The greatest deviation of a step within these frames (n,) from their usual one, in usual steps."""
    step = np.diff(time_s)
    return float(np.abs(step / np.median(step) - 1.0).max()) if len(step) else 0.0


def filter_stretch(
    time_s: np.ndarray, position_m: np.ndarray, sigma_m: np.ndarray, cutoff_hz: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Position (n, 3) and sigma (n,) of one joint that is known in all frames; None for too short a stretch.

    Sigma stays as it was, or becomes the rms of the neighbours within half a period of the cutoff where that is larger:
    systematic errors are not filtered away, and a poorly known frame moves its neighbours.
    """
    rate_hz = 1.0 / float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    if not rate_hz or len(time_s) < shortest_frames(rate_hz, cutoff_hz):
        return None
    reach = max(1, round(0.5 * rate_hz / cutoff_hz))
    padded = np.pad(sigma_m, reach, mode="edge")
    near = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    return low_pass(position_m, rate_hz, cutoff_hz), np.maximum(sigma_m, np.sqrt((near**2).mean(axis=1)))
