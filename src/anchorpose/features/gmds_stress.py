"""The generalised stress of a map of samples, and the moves that make it small."""

from __future__ import annotations

import numpy as np
from numba import njit


def stress_m(a: np.ndarray, b: np.ndarray, cap: float) -> float:
    """Root mean square over all pairs of samples of the capped change from a to b (k, k), both in metres."""
    change = np.minimum(np.abs(a - b, dtype=np.float64), cap)
    np.fill_diagonal(change, 0.0)
    return float(np.sqrt((change**2).sum() / max(len(a) * (len(a) - 1), 1)))


@njit(cache=True, error_model="numpy")
def best_places(rows: np.ndarray, fields: np.ndarray, cap: float, own: np.ndarray) -> np.ndarray:
    """(m,) int32: where each point costs least, by its distances to samples whose places are known.

    rows (m, k) float32: distances on the source; fields (k, n) float32: those of the samples' places to every node of
    the target; both metres. own (m,) int: the sample that a row is itself and that does not count, -1 = none. The cost
    is the sum of squared changes, none counting for more than the cap.
    """
    places = np.empty(len(rows), np.int32)
    cost, most = np.empty(fields.shape[1], np.float32), np.float32(cap)
    for row in range(len(rows)):
        cost[:] = 0.0
        for k in range(len(fields)):
            if k != own[row]:
                field, distance = fields[k], rows[row, k]
                for v in range(len(cost)):
                    change = min(abs(field[v] - distance), most)
                    cost[v] += change * change
        places[row] = cost.argmin()
    return places


@njit(cache=True, error_model="numpy")
def settle(a: np.ndarray, b: np.ndarray, places: np.ndarray, known: int, cap: float, sweeps: int) -> None:
    """Place the samples beyond the first ``known``, then move one after another as long as that helps.

    a (k, k) float32 distances of the samples, b (n, n) float32 of all candidates for places; places (k,) int32,
    changed in place.
    """
    costs, most, calm = np.empty(len(b), np.float32), np.float32(cap), 0
    for step in range(known, (sweeps + 1) * len(a)):
        at, first_time = step % len(a), step < len(a)
        costs[:] = 0.0
        for k in range(at if first_time else len(a)):
            if k != at:
                for v in range(len(b)):
                    change = min(abs(b[places[k], v] - a[at, k]), most)
                    costs[v] += change * change
        place = costs.argmin()
        if first_time or costs[place] < costs[places[at]]:
            places[at], calm = place, 0
            continue
        calm += 1
        if calm == len(a):
            break
