"""Provide compiled functions for angles: fast arctangents, and peaks of histograms whose bins are directions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

FULL_TURN = 2.0 * np.pi

SMALLEST = 5e-324  # minimum divisor in ``turn_fraction``, so that the direction of a zero vector is 0, not NaN

ARC = (
    0.159154940193,
    -0.0530511756054,
    0.0318180525506,
    -0.0225964969971,
    0.0168996617356,
    -0.0118679530359,
    0.00670641106217,
    -0.00250370604512,
    0.000440267689862,
)
"""atan(z) / (2 pi z) as a polynomial in z^2, through the Chebyshev points of 0 <= z^2 <= 1; the error is below 2e-9."""


@njit(cache=True, error_model="numpy")
def turn_fraction(x: float, y: float, begin: float) -> float:
    """Return the direction of (x, y) relative to the direction ``begin``, both as shares of a turn in [0, 1).

    This function is faster than a library's arctangent.
    """
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
    # A value just below 0 is rounded to 1.0, which means the same direction as 0
    return fraction if fraction < 1.0 else 0.0


@njit(cache=True)
def spread_over_two(bins: np.ndarray, fraction: float, weight: float) -> None:
    """Divide a weight between the two bins whose middles are nearest to a direction; the nearer bin gets more.

    fraction: the direction, as a share of a turn.
    """
    at = fraction * len(bins) - 0.5
    low = int(np.floor(at))
    part = at - low
    # ``%`` is not used to wrap the index, since this operation alone would take longer than all other steps of the
    # function
    low = low if low >= 0 else len(bins) - 1
    bins[low] += weight * (1.0 - part)
    bins[low + 1 if low + 1 < len(bins) else 0] += weight * part


@njit(cache=True)
def peak_fraction(bins: np.ndarray) -> float:
    """Return the direction of the highest peak of a histogram, as a share of a turn.

    The peak is the top of the parabola through the fullest bin (the first, if several are equally full) and its two
    neighbours.
    """
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
    """Replace every bin, ``rounds`` times, by the mean of itself and its neighbours, weighted 1 : 2 : 1.

    Each round increases the variance of a peak by 0.5, in squared widths of a bin.
    """
    for _ in range(rounds):
        first, before = bins[0], bins[-1]
        for b in range(len(bins)):
            here, after = bins[b], bins[b + 1] if b + 1 < len(bins) else first
            bins[b] = 0.25 * before + 0.5 * here + 0.25 * after
            before = here


# arctan(t) / t as a polynomial in t^2, interpolated at Chebyshev nodes; the error is below 1e-7 rad in single precision
_A0, _A1, _A2, _A3 = (np.float32(a) for a in (0.999999982, -0.333330367, 0.19991872, -0.141977978))
_A4, _A5, _A6, _A7 = (np.float32(a) for a in (0.106183706, -0.0745685481, 0.0421376235, -0.015731249))
_A8 = np.float32(0.00276628348)
ZERO: Any
ONE: Any
# Constants in float32; with Python's literals, all results would be float64
ZERO, ONE = np.float32(0.0), np.float32(1.0)
PI, HALF_PI = np.float32(np.pi), np.float32(np.pi / 2)


@njit(cache=True, error_model="numpy")
def angle_of(y: Any, x: Any) -> Any:
    """Return the angle of (x, y) float32 from the x axis, radians, -pi to pi; 0 for a zero vector. The code has no
    branches, so the compiler can vectorise it.
    """
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
