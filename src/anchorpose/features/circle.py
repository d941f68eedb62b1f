"""Histograms around a circle: filling them, and the angle of their peak."""

from __future__ import annotations

import numpy as np
from numba import njit

FULL_TURN = 2.0 * np.pi


@njit(cache=True)
def turn_fraction(x: float, y: float, begin: float) -> float:
    """Where (x, y) points, in [0, 1) of a turn from the angle begin."""
    fraction = (np.arctan2(y, x) - begin) / FULL_TURN
    fraction -= np.floor(fraction)
    return fraction if fraction < 1.0 else 0.0  # what is a rounding below 0 gives 1


@njit(cache=True)
def spread_over_two(bins: np.ndarray, fraction: float, weight: float) -> None:
    """Shares a weight between the two bins whose middles are next to a fraction of a turn."""
    at = fraction * len(bins) - 0.5
    low = int(np.floor(at))
    bins[low % len(bins)] += weight * (1.0 - (at - low))
    bins[(low + 1) % len(bins)] += weight * (at - low)


@njit(cache=True)
def peak_angle(bins: np.ndarray) -> float:
    """The angle at the top of the parabola through the fullest bin, the first of several, and the two beside it."""
    peak = 0
    for b in range(len(bins)):
        if bins[b] > bins[peak]:
            peak = b
    before, after = bins[(peak - 1) % len(bins)], bins[(peak + 1) % len(bins)]
    bend = before - 2.0 * bins[peak] + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return (peak + 0.5 + shift) / len(bins) * FULL_TURN
