"""Compute the uncertainty of a mean over frames from systematic and random errors.

Most of a joint's error is systematic (the same in all frames), so a mean over many frames is not much more certain than
a single frame.
"""

from __future__ import annotations

from typing import Final

import numpy as np

CONFIDENCE: Final = 0.95
"""Level of all confidence intervals."""

NORMAL_95: Final = 1.96
"""Half width, in standard deviations, of the interval that holds 95 of 100 values of a normal distribution."""

ANGLE_SHARE: Final = 0.5
"""Share of the variance of an angle's error that stays the same through a recording: errors of the learnt body's
lengths, of clothes, and of the joints' places in the body. The value is the rounded mean of the column "lasting share"
in the measured table of docs/angles.md.
"""

JOINT_SHARE: Final = 0.7
"""Share of the variance that stays the same through a recording, for errors of joints and of values computed from joint
positions. A value of 0.8 was found once on simulated recordings, but no table reproduces it; a lower value is used.
"""

CORRELATION_S: Final = 1.5
"""Correlation time in s of the random part of an error: after this time, its autocorrelation is about a third."""


def systematic_share(unit: str) -> float:
    """Return which share of the variance of values in this unit is due to systematic errors: the share measured for
    angles if the unit is ``deg``, otherwise the share measured for joint positions.
    """
    return ANGLE_SHARE if unit == "deg" else JOINT_SHARE


def sigma_of_mean(sigma: np.ndarray, seconds: np.ndarray, share: float) -> float:
    """Return sigma of the mean over time of values (k,) with the standard deviations ``sigma`` (k,). seconds (k,): the
    time that each value represents; share: the systematic share of the variance, ``ANGLE_SHARE`` or ``JOINT_SHARE``.

    Averaging does not reduce the systematic share of the variance; the random share decreases as if every two
    correlation times gave one independent value.
    """
    averaged = min(1.0, 2.0 * CORRELATION_S / float(seconds.sum()))
    return float(np.sqrt(np.average(sigma**2, weights=seconds) * (share + (1.0 - share) * averaged)))


def systematic_sigma(sigma: np.ndarray, share: float) -> np.ndarray:
    """Return the systematic part of sigma, which stays the same through a recording."""
    return np.sqrt(share) * sigma


def random_sigma(sigma: np.ndarray, share: float) -> np.ndarray:
    """Return the random part of sigma, which differs from time to time."""
    return np.sqrt(1.0 - share) * sigma


def sigma_of_difference(first: float, second: float, share: float) -> float:
    """Return sigma of the difference between values at two times of one recording, from the sigma of each value.

    The systematic errors are common to both values, so they cancel completely if both sigmas are equal, else in part.
    """
    return float(np.sqrt(first**2 + second**2 - 2.0 * share * first * second))
