"""Movement as two systems see it alike, wherever their axes lie: distances between joints, and angles, over time.

A distance between two joints does not depend on the frame of reference, so the movement can be matched in time before
anything is known about space.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

GRID_HZ: Final = 100.0
"""Of the common grid: the movement is smooth between its times."""

SMOOTHING_S: Final = 0.04
"""Standard deviation of the kernel that both systems are smoothed with alike, against noise of either: 4 Hz
pass, and most of people's movement is slower."""

LONGEST_GAP_S: Final = 0.15
"""Across a longer gap nothing is interpolated."""

MOST_SIGNALS: Final = 40

LEAST_MOVEMENT_M: Final = 0.02
LEAST_MOVEMENT_DEG: Final = 4.0
"""Standard deviation over the recording: below it a signal is mostly noise."""

LEAST_KNOWN: Final = 0.2
"""Share of the frames in which a signal must be known."""


@dataclass(frozen=True, slots=True, eq=False)
class Signals:
    """time_s (g,) evenly spaced by 1 / ``GRID_HZ``; values (g, k), NaN in gaps; scaled alike, by typical movement."""

    time_s: np.ndarray
    values: np.ndarray


def common_signals(
    ours: tuple[np.ndarray, np.ndarray, np.ndarray], theirs: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> tuple[Signals, Signals] | None:
    """Signals that both have and that move; None where there is none.

    Of each: time_s (n,), position_m (n, 21, 3), degrees (n, a), the same angles in both. NaN where missing.
    """
    columns = [_raw(position, degrees) for _, position, degrees in (ours, theirs)]
    known = np.minimum(*(np.isfinite(each).mean(axis=0) for each in columns))
    spread = np.minimum(*(_spread(each) for each in columns))
    angles = ours[2].shape[1]
    least = np.append(np.full(len(spread) - angles, LEAST_MOVEMENT_M), np.full(angles, LEAST_MOVEMENT_DEG))
    moving = spread / least
    moving[(known < LEAST_KNOWN) | ~np.isfinite(moving)] = 0.0
    best = np.argsort(-moving, kind="stable")[:MOST_SIGNALS]
    best = best[moving[best] >= 1.0]
    if not len(best):
        return None
    both = [
        _on_grid(time_s, (each / least)[:, best]) for (time_s, _, _), each in zip((ours, theirs), columns, strict=True)
    ]
    return both[0], both[1]


def position_signals(time_s: np.ndarray, position_m: np.ndarray) -> Signals:
    """Coordinates (n, 21, 3) of joints in one frame, once that is known: they say more than distances."""
    return _on_grid(time_s, position_m.reshape(len(time_s), -1) / LEAST_MOVEMENT_M)


def _raw(position_m: np.ndarray, degrees: np.ndarray) -> np.ndarray:
    pairs = np.array(list(combinations(range(position_m.shape[1]), 2)))
    distance = np.linalg.norm(position_m[:, pairs[:, 0]] - position_m[:, pairs[:, 1]], axis=2)
    return np.concatenate([distance, degrees], axis=1)


def _spread(values: np.ndarray) -> np.ndarray:
    """(k,) standard deviation of the known values; NaN where fewer than two are known."""
    count = np.isfinite(values).sum(axis=0)
    filled = np.nan_to_num(values)
    mean = filled.sum(axis=0) / np.maximum(count, 1)
    square = (np.where(np.isfinite(values), values - mean, 0.0) ** 2).sum(axis=0)
    return np.where(count > 1, np.sqrt(square / np.maximum(count - 1, 1)), np.nan)


def _on_grid(time_s: np.ndarray, values: np.ndarray) -> Signals:
    grid_s = np.arange(time_s[0], time_s[-1], 1.0 / GRID_HZ)
    found = np.stack([at_times(time_s, values[:, column], grid_s) for column in range(values.shape[1])], axis=1)
    known = np.isfinite(found)
    width = SMOOTHING_S * GRID_HZ
    weight = gaussian_filter1d(known.astype(np.float64), width, axis=0, mode="constant")
    smooth = gaussian_filter1d(np.nan_to_num(found), width, axis=0, mode="constant")
    # near a gap or an end the kernel is one-sided, which would shift the movement in time
    whole = known & (weight > 0.95)
    return Signals(grid_s, np.where(whole, smooth / np.where(whole, weight, 1.0), np.nan))


def at_times(time_s: np.ndarray, values: np.ndarray, wanted_s: np.ndarray) -> np.ndarray:
    """values (n,) at other times (m,), linear; NaN outside, and between neighbours over ``LONGEST_GAP_S`` apart."""
    known = np.isfinite(values)
    if known.sum() < 2:
        return np.full(len(wanted_s), np.nan)
    times, heights = time_s[known], values[known]
    usual_s = float(np.median(np.diff(time_s)))
    after = np.clip(np.searchsorted(times, wanted_s), 1, len(times) - 1)
    near = times[after] - times[after - 1] <= max(LONGEST_GAP_S, 1.5 * usual_s)
    inside = (wanted_s >= times[0]) & (wanted_s <= times[-1])
    return np.where(near & inside, np.interp(wanted_s, times, heights), np.nan)


def resampled(time_s: np.ndarray, values: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """Values (t, ...) at other times, (n, ...); NaN in gaps and where they are missing."""
    flat = values.reshape(len(time_s), -1)
    found = np.full((len(at_s), flat.shape[1]), np.nan)
    for column in np.flatnonzero(np.isfinite(flat).any(axis=0)):
        found[:, column] = at_times(time_s, flat[:, column], at_s)
    return found.reshape(len(at_s), *values.shape[1:])
