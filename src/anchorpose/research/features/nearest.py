"""The row of one table of descriptors that is nearest to each row of another."""

from __future__ import annotations

from enum import StrEnum
from typing import Final

import numpy as np
from scipy.spatial.distance import cdist

ROWS: Final = 1000  # source rows whose distances to all target rows are held at once: 32 MB for 4,000 of them


class Metric(StrEnum):
    """How the distance between two descriptors is measured."""

    EUCLIDEAN = "euclidean"
    HELLINGER = "hellinger"  # Euclidean between the square roots, of rows as they are: none is normalised here
    MANHATTAN = "manhattan"


def nearest_descriptor(source: np.ndarray, target: np.ndarray, metric: Metric | str = Metric.EUCLIDEAN) -> np.ndarray:
    """(m,) int32: the row of target nearest to each row of source, but for the rounding of float64.

    source (m, d), target (n, d), compared as float32 values. A row with a value that is not finite is undefined: -1
    for such a row of source, and such a row of target is never chosen; -1 too where target has no other rows. Raises
    ValueError where the widths differ, for an unknown metric, and for negative values under HELLINGER.
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
    for first in range(0, len(source), ROWS):
        rows = source[first : first + ROWS]
        apart = cdist(rows, target, "cityblock") if metric is Metric.MANHATTAN else _squares(rows, target)
        nearest[known[first : first + ROWS]] = choice[apart.argmin(axis=1)]
    return nearest


def _squares(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(m, n) squared distances minus |s|^2, which is constant in a row; much faster than scipy for wide tables.

    The mean is subtracted first, so that squares are not much larger than their differences.
    """
    mean = target.mean(axis=0)
    moved = target - mean
    return np.einsum("ij,ij->i", moved, moved) - 2.0 * ((source - mean) @ moved.T)
