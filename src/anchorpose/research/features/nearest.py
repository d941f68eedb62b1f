"""Find, for each row of a table of descriptors, the nearest row of another table.

All distances are first computed in float32, which is fast. Distances that, because of rounding, cannot be distinguished
from the smallest distance are then computed again in float64.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Final

import numpy as np
from numba import njit

ROWS: Final = 1000  # number of source rows whose distances are in memory at once: 16 MB for 4,000 target rows
COLUMNS: Final = 256  # number of target rows compared with a source row at once, few enough for the processor's cache
ULP: Final = 2.0**-23  # precision of float32: twice the relative error of a single rounding


class Metric(StrEnum):
    """The distance measure between two descriptors."""

    EUCLIDEAN = "euclidean"
    # Euclidean distance between the square roots of the rows; this module does not normalise rows
    HELLINGER = "hellinger"
    MANHATTAN = "manhattan"


def nearest_descriptor(source: np.ndarray, target: np.ndarray, metric: Metric | str = Metric.EUCLIDEAN) -> np.ndarray:
    """Return (m,) int32: the row of target nearest to each row of source, up to the rounding of float64.

    source (m, d) and target (n, d) are compared as float32 values. A row with a value that is not finite is undefined:
    if it is in source, its result is -1; if it is in target, it is never chosen. If all target rows are undefined, all
    results are -1. Of equally near rows, the first is chosen. Raises ValueError if the widths differ, for an unknown
    metric, and for negative values with HELLINGER.
    """
    metric = Metric(metric)
    source, target = (np.asarray(table, dtype=np.float32).astype(np.float64) for table in (source, target))
    if source.ndim != 2 or target.ndim != 2 or source.shape[1] != target.shape[1]:
        raise ValueError(f"two tables of the same width are compared, got {source.shape} and {target.shape}")
    known, choice = (np.flatnonzero(np.isfinite(table).all(axis=1)) for table in (source, target))
    nearest = np.full(len(source), -1, np.int32)
    if len(known) == 0 or len(choice) == 0:
        return nearest
    source, target = source[known], target[choice]
    if metric is Metric.HELLINGER:
        if min(source.min(initial=0), target.min(initial=0)) < 0:
            raise ValueError(f"{metric} is for histograms, which have no values below 0")
        np.sqrt(source, out=source)
        np.sqrt(target, out=target)
    manhattan = metric is Metric.MANHATTAN
    roughly = _RoughDifferences(target) if manhattan else _RoughSquares(target)
    for first in range(0, len(source), ROWS):
        rows = source[first : first + ROWS]
        found = _settle(*roughly.apart(rows), rows, target, manhattan)
        nearest[known[first : first + ROWS]] = choice[found]
    return nearest


class _RoughDifferences:
    """Rough Manhattan distances to the rows of a table (n, d)."""

    def __init__(self, target: np.ndarray) -> None:
        self._columns = np.ascontiguousarray(target.T, dtype=np.float32)

    def apart(self, source: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rough distances (m, n) float32, and an error bound (m,) for each row.

        The bound holds for the sum of the errors of two distances of the row: the smallest distance and any other
        distance. The error of a sum of d values that are not negative is at most d + 1 roundings of the sum.
        """
        apart = _sum_of_differences(source.astype(np.float32), self._columns)
        return apart, 2.0 * (len(self._columns) + 2) * ULP * apart.min(axis=1)


class _RoughSquares:
    """Rough squared distances to the rows of a table (n, d), without |s|^2, which is constant for a source row s.

    The table's mean row is subtracted from all rows: smaller values have smaller squares, so the rounding errors of the
    squares matter less for the distances.
    """

    def __init__(self, target: np.ndarray) -> None:
        self._mean = target.mean(axis=0)
        moved = target - self._mean
        # values are divided by the largest absolute value, since squares of float32 soon overflow or become 0
        self._unit = float(np.abs(moved).max(initial=0.0)) or 1.0
        moved /= self._unit
        size2 = np.einsum("ij,ij->i", moved, moved)
        self._largest = float(np.sqrt(size2.max()))
        self._size2, self._columns = size2.astype(np.float32), moved.astype(np.float32).T

    def apart(self, source: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rough squared distances (m, n) of source (m, d), and an error bound (m,) for each row."""
        moved = (source - self._mean) / self._unit
        length = np.linalg.norm(moved, axis=1)
        with np.errstate(over="ignore", invalid="ignore"):
            apart = self._size2 - np.float32(2.0) * (moved.astype(np.float32) @ self._columns)
        return apart, 2.0 * (len(self._columns) + 4) * ULP * self._largest * (length + self._largest)


@njit(cache=True)
def _sum_of_differences(source: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return (m, n) float32 Manhattan distances of source (m, d) from the rows of a table, given as columns (d, n)."""
    width, count = columns.shape
    apart = np.zeros((len(source), count), np.float32)
    for first in range(0, count, COLUMNS):
        for row in range(len(source)):
            sums = apart[row, first : first + COLUMNS]
            for k in range(width):
                value, others = source[row, k], columns[k, first : first + COLUMNS]
                for other in range(len(sums)):
                    sums[other] += abs(others[other] - value)
    return apart


@njit(cache=True)
def _settle(
    rough: np.ndarray, slack: np.ndarray, source: np.ndarray, target: np.ndarray, manhattan: bool
) -> np.ndarray:
    """Return (m,) int64: the nearest target row, out of the rows whose rough distance is close to the smallest rough
    distance.

    slack (m,): a target row is computed again if its rough distance exceeds the smallest by at most this.
    """
    nearest = np.zeros(len(source), np.int64)
    for row in range(len(source)):
        best, limit = np.inf, rough[row].min() + slack[row]
        for other in range(len(target)):
            if not rough[row, other] > limit:  # this condition is true also if float32 has overflowed
                apart = 0.0
                for k in range(source.shape[1]):
                    off = source[row, k] - target[other, k]
                    apart += abs(off) if manhattan else off * off
                if apart < best:
                    best, nearest[row] = apart, other
    return nearest
