"""Compute the uncertainty of a mean over frames from systematic and random errors.

Most of a joint's error is systematic, so a mean over more frames is not much more certain.
"""

from __future__ import annotations

from typing import Final

import numpy as np

NORMAL_95: Final = 1.96
"""Half width, in standard deviations, of the interval that holds 95 of 100 values of a normal distribution."""

SYSTEMATIC_SHARE: Final = 0.7
"""Share of an error's variance that stays the same through a recording: errors of the learnt body's lengths, of
clothes, and of the joints' places in the body. On simulated recordings it is 0.6 for angles and 0.8 for joints
(docs/measures.md); 0.7 is used for both.
"""

CORRELATION_S: Final = 1.5
"""Time in s after which the autocorrelation of the random part of an error has fallen to about a third."""


def sigma_of_mean(sigma: np.ndarray, seconds: float) -> float:
    """Return sigma of the mean of values (k,) that are spread over ``seconds`` and have the standard deviations
    ``sigma``.

    Averaging does not reduce the systematic share of the variance; it reduces the random share as if every two
    correlation times gave one independent value.
    """
    averaged = min(1.0, 2.0 * CORRELATION_S / seconds) if seconds > 0 else 1.0
    return float(np.sqrt(np.mean(sigma**2) * (SYSTEMATIC_SHARE + (1.0 - SYSTEMATIC_SHARE) * averaged)))


def systematic_sigma(sigma: np.ndarray) -> np.ndarray:
    """Return the systematic part of sigma, which stays the same through a recording."""
    return np.sqrt(SYSTEMATIC_SHARE) * sigma


def random_sigma(sigma: np.ndarray) -> np.ndarray:
    """Return the random part of sigma, which differs from time to time."""
    return np.sqrt(1.0 - SYSTEMATIC_SHARE) * sigma


def sigma_of_difference(first: float, second: float) -> float:
    """Return sigma of the difference between values at two times of one recording, from the sigma of each value.

    The systematic errors are common to both values, so they cancel completely if both sigmas are equal, else in part.
    """
    return float(np.sqrt(first**2 + second**2 - 2.0 * SYSTEMATIC_SHARE * first * second))
