"""Histograms around a circle: filling them, and the angle of their peak."""

from __future__ import annotations

import numpy as np
from numba import njit

FULL_TURN = 2.0 * np.pi

SMALLEST = 5e-324  # keeps the direction of nothing from being that of NaN

ARC = (0.159154940193, -0.0530511756054, 0.0318180525506, -0.0225964969971, 0.0168996617356,
       -0.0118679530359, 0.00670641106217, -0.00250370604512, 0.000440267689862)  # fmt: skip
"""atan(z) / (2 pi z) as a polynomial in z^2, through the Chebyshev points of 0 <= z^2 <= 1: within 2e-9 of a turn."""


@njit(cache=True, error_model="numpy")
def turn_fraction(x: float, y: float, begin: float) -> float:
    """Where (x, y) points, in [0, 1) of a turn from begin, itself a part of a turn; a library's arctangent is slow."""
    wide, high = abs(x), abs(y)
    ratio = min(wide, high) / max(wide, high, SMALLEST)
    square = ratio * ratio
    fraction = ARC[8]
    for k in range(7, -1, -1):
        fraction = fraction * square + ARC[k]
    fraction *= ratio
    if high > wide:
        fraction = 0.25 - fraction
    if x < 0.0:
        fraction = 0.5 - fraction
    if y < 0.0:
        fraction = -fraction
    fraction -= begin
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
def peak_fraction(bins: np.ndarray) -> float:
    """The part of a turn at the top of the parabola through the fullest bin, the first of several, and both beside."""
    peak = 0
    for b in range(len(bins)):
        if bins[b] > bins[peak]:
            peak = b
    before, after = bins[(peak - 1) % len(bins)], bins[(peak + 1) % len(bins)]
    bend = before - 2.0 * bins[peak] + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return (peak + 0.5 + shift) / len(bins)


@njit(cache=True)
def smooth(bins: np.ndarray, rounds: int) -> None:
    """Mixes every bin with the two beside it, 1 : 2 : 1, so many times; each adds half a bin's square of variance."""
    for _ in range(rounds):
        first, before = bins[0], bins[-1]
        for b in range(len(bins)):
            here, after = bins[b], bins[b + 1] if b + 1 < len(bins) else first
            bins[b] = 0.25 * before + 0.5 * here + 0.25 * after
            before = here
