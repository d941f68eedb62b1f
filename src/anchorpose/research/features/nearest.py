"""Which row of one table of descriptors is nearest to each row of another."""

from __future__ import annotations

from enum import StrEnum
from typing import Final

import numpy as np
from numba import njit

ROWS: Final = 256  # source rows whose distances to all target rows are held at once: 4 MB for 4,000 of them
LANES: Final = 16  # target rows compared abreast
STRETCH: Final = 32  # columns after which a comparison that is already lost ends


class Metric(StrEnum):
    """How far apart two descriptors a and b are."""

    EUCLIDEAN = "euclidean"
    HELLINGER = "hellinger"  # Euclidean between the square roots, of rows as they are: none is normalised here
    MANHATTAN = "manhattan"
    CHI_SQUARED = "chi-squared"  # sum of (a - b)^2 / (a + b), nothing where both are 0


def nearest_descriptor(source: np.ndarray, target: np.ndarray, metric: Metric | str = Metric.EUCLIDEAN) -> np.ndarray:
    """(m,) int32: the row of target nearest to each row of source; of rows equally near, the first.

    source (m, d), target (n, d), compared as float32. A row with a value that is not finite is undefined: -1 where the
    source's is, and such a row of target is never chosen; -1 too where target has no other rows. Raises ValueError
    where the widths differ, for an unknown metric, and for values below 0 where the metric has no meaning for them.
    """
    metric = Metric(metric)
    source, target = (np.ascontiguousarray(table, dtype=np.float32) for table in (source, target))
    if source.ndim != 2 or target.ndim != 2 or source.shape[1] != target.shape[1]:
        raise ValueError(f"two tables of the same width are compared, got {source.shape} and {target.shape}")
    known, choice = _defined(source), np.flatnonzero(_defined(target))
    nearest = np.full(len(source), -1, np.int32)
    if not known.any() or len(choice) == 0:
        return nearest
    source, target = _rows(source, np.flatnonzero(known)), _rows(target, choice)
    if metric in (Metric.HELLINGER, Metric.CHI_SQUARED) and min(source.min(initial=0), target.min(initial=0)) < 0:
        raise ValueError(f"{metric} is for histograms, which have no values below 0")
    if metric in (Metric.EUCLIDEAN, Metric.HELLINGER):
        nearest[known] = choice[_by_products(source, target, metric is Metric.HELLINGER)]
    else:
        nearest[known] = choice[_by_columns(source, _abreast(target), len(target), metric is Metric.CHI_SQUARED)]
    return nearest


def _defined(table: np.ndarray) -> np.ndarray:
    """(m,) bool. A sum is finite where all its terms are, unless they overflow: only other rows need a second look."""
    with np.errstate(over="ignore", invalid="ignore"):
        defined = np.isfinite(table.sum(axis=1))
    for row in np.flatnonzero(~defined):
        defined[row] = np.isfinite(table[row]).all()
    return defined


def _rows(table: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    return table if len(chosen) == len(table) else table[chosen]


def _by_products(source: np.ndarray, target: np.ndarray, roots: bool) -> np.ndarray:
    """(m,) int64 by |s - t|^2 = |s|^2 - 2 s.t + |t|^2, whose rounding leaves a few candidates; these are compared well.

    Taking the mean away first keeps the products from being much larger than what they differ by.
    """
    near = np.sqrt(target) if roots else target.copy()
    mean = near.mean(axis=0, dtype=np.float64).astype(np.float32)
    largest = max(float(np.abs(near).max(initial=0)), float(np.abs(source).max(initial=0)) ** (0.5 if roots else 1.0))
    scale = np.float32(1.0 / largest if largest > 0 else 1.0)  # so that no square overflows
    near -= mean
    near *= scale
    square = np.einsum("ij,ij->i", near, near)
    longest = np.sqrt(target.sum(axis=1).max()) if roots else np.float32(0.0)  # of the roots, which are rounded too
    nearest = np.empty(len(source), np.int64)
    for first in range(0, len(source), ROWS):
        block = np.sqrt(source[first : first + ROWS]) if roots else source[first : first + ROWS]
        moved = (block - mean) * scale
        lengths = np.sqrt(np.einsum("ij,ij->i", moved, moved)) + np.sqrt(square.max())
        rounded = 4.0 * scale * (np.sqrt(source[first : first + ROWS].sum(axis=1)) + longest) if roots else 0.0
        slack = 2.0 * np.finfo(np.float32).eps * lengths * ((source.shape[1] + 8) * lengths + rounded)
        score = moved @ near.T
        score *= np.float32(-2.0)
        score += square
        nearest[first : first + ROWS] = _best_candidates(score, slack, source[first : first + ROWS], target, roots)
    return nearest


@njit(cache=True)
def _best_candidates(
    score: np.ndarray, slack: np.ndarray, source: np.ndarray, target: np.ndarray, roots: bool
) -> np.ndarray:
    """Of the targets whose score may be the lowest but for its rounding, the first that is nearest."""
    nearest = np.empty(len(source), np.int64)
    for row in range(len(source)):
        lowest = np.inf
        for j in range(len(target)):
            lowest = min(lowest, score[row, j])
        found, best = -1, np.inf
        for j in range(len(target)):
            if score[row, j] > lowest + slack[row]:
                continue
            distance2 = 0.0
            for k in range(source.shape[1]):
                if roots:
                    offset = np.sqrt(np.float64(source[row, k])) - np.sqrt(np.float64(target[j, k]))
                else:
                    offset = np.float64(source[row, k]) - np.float64(target[j, k])
                distance2 += offset * offset
                if distance2 > best:
                    break
            if distance2 < best or found < 0:
                best, found = distance2, j
        nearest[row] = found
    return nearest


def _abreast(target: np.ndarray) -> np.ndarray:
    """(groups, d, LANES) float32: rows side by side; the last group is filled up with the last row."""
    count = -(-len(target) // LANES) * LANES
    filled = np.minimum(np.arange(count), len(target) - 1)
    return np.ascontiguousarray(target[filled].reshape(-1, LANES, target.shape[1]).transpose(0, 2, 1))


@njit(cache=True)
def _by_columns(source: np.ndarray, groups: np.ndarray, count: int, chi_squared: bool) -> np.ndarray:
    """(m,) int64 by comparing everything; a group of targets is left as soon as none of it can win."""
    nearest = np.empty(len(source), np.int64)
    total, part = np.empty(LANES), np.empty(LANES, np.float32)
    zero, one = np.float32(0.0), np.float32(1.0)
    columns = source.shape[1]
    for row in range(len(source)):
        found, best = -1, np.inf
        for group in range(len(groups)):
            total[:] = 0.0
            for first in range(0, columns, STRETCH):
                part[:] = zero
                for k in range(first, min(first + STRETCH, columns)):
                    own = source[row, k]
                    for lane in range(LANES):
                        other = groups[group, k, lane]
                        if chi_squared:
                            both = own + other
                            part[lane] += (own - other) * ((own - other) / (both if both > zero else one))
                        else:
                            part[lane] += abs(own - other)
                lowest = np.inf
                for lane in range(LANES):
                    total[lane] += part[lane]
                    lowest = min(lowest, total[lane])
                if lowest >= best:
                    break
            else:
                for lane in range(min(LANES, count - group * LANES)):
                    if total[lane] < best or found < 0:
                        best, found = total[lane], group * LANES + lane
        nearest[row] = found
    return nearest
