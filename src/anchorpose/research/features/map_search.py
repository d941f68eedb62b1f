"""Search for the map from one set of points to another with the least stress, given the distances within each set.

The stress is the root mean square of the changes of the distances between points, each change capped. Branch and bound
finds the best maps of few samples; ``settle`` and ``best_places`` improve maps of many samples, one sample at a time.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def branch_and_bound(
    a: np.ndarray, b: np.ndarray, cap: float, limit: float, kept: int, same: float, steps: int
) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the best of all maps of k samples onto n candidates, and the best maps that differ from it.

    a (k, k), b (n, n): float32 distances in each set. The cost of a map is the sum of the squared, capped changes over
    all pairs of samples. limit: maps with at least this cost are ignored. same: maximum distance (m) between the two
    places of every sample in maps that count as the same; of such maps, only the better map is kept. Returns maps
    (kept, k) int32 and costs (kept,) float64, best first, inf = no map, and the number of branches visited. This number
    is ``steps`` if the search gave up; a better map may then exist.
    """
    depth, count = len(a), len(b)
    maps, costs = np.full((kept, depth), -1, np.int32), np.full(kept, np.inf)
    table = np.zeros((depth + 1, depth, count))
    order = np.zeros((depth, count), np.int64)
    turn, base, rest = np.zeros(depth, np.int64), np.zeros(depth + 1), np.zeros(depth)
    chosen = np.zeros(depth, np.int32)
    level, done = 0, 0
    order[0] = np.arange(count)
    for i in range(1, depth):
        rest[0] += table[0, i].min()
    while level >= 0 and done < steps:
        bound = min(limit, costs[-1])
        spot = turn[level]
        if spot == count or base[level] + table[level, level, order[level, spot]] + rest[level] >= bound:
            level -= 1
            continue
        turn[level] += 1
        done += 1
        place = order[level, spot]
        chosen[level] = place
        cost = base[level] + table[level, level, place]
        if level == depth - 1:
            _keep(chosen, cost, b, same, maps, costs)
            continue
        floor = _place_sample(a, b, level, place, cap, table)
        if cost + floor + table[level + 1, level + 1].min() >= bound:
            continue
        level += 1
        base[level], rest[level], turn[level] = cost, floor, 0
        order[level] = np.argsort(table[level, level])
    return maps, costs, done


@njit(cache=True, error_model="numpy")
def _place_sample(a: np.ndarray, b: np.ndarray, level: int, place: int, cap: float, table: np.ndarray) -> float:
    """Map sample ``level`` to the candidate ``place``.

    Fill table[level + 1] with the cost of each later sample at each candidate.

    Return a lower bound of the cost of all samples after the next sample.
    """
    floor = 0.0
    for i in range(level + 1, len(a)):
        for v in range(len(b)):
            change = min(abs(np.float64(a[i, level]) - b[place, v]), cap)
            table[level + 1, i, v] = table[level, i, v] + change * change
        if i > level + 1:
            floor += table[level + 1, i].min()
    return floor


@njit(cache=True, error_model="numpy")
def _keep(chosen: np.ndarray, cost: float, b: np.ndarray, same: float, maps: np.ndarray, costs: np.ndarray) -> None:
    """Insert a map into the sorted list of best maps, in place of similar maps, unless a similar map is better."""
    held = 0
    while held < len(costs) and costs[held] < np.inf:
        held += 1
    for m in range(held):
        if costs[m] <= cost and _alike(maps[m], chosen, b, same):
            return
    left = 0
    for m in range(held):
        if not _alike(maps[m], chosen, b, same):
            maps[left], costs[left] = maps[m], costs[m]
            left += 1
    costs[left:held] = np.inf
    at = min(left, len(costs) - 1)
    while at > 0 and costs[at - 1] > cost:
        maps[at], costs[at] = maps[at - 1], costs[at - 1]
        at -= 1
    if cost < costs[at]:
        maps[at], costs[at] = chosen, cost


@njit(cache=True, error_model="numpy")
def _alike(one: np.ndarray, other: np.ndarray, b: np.ndarray, same: float) -> bool:
    apart = np.float32(0.0)
    for k in range(len(one)):
        apart = max(apart, b[one[k], other[k]])
    return bool(apart <= same)


def stress_m(a: np.ndarray, b: np.ndarray, cap: float) -> float:
    """Return the root mean square, over all pairs of samples, of the capped change of distance from a to b.

    a, b (k, k): metres.
    """
    change = np.minimum(np.abs(a - b, dtype=np.float64), cap)
    np.fill_diagonal(change, 0.0)
    return float(np.sqrt((change**2).sum() / max(len(a) * (len(a) - 1), 1)))


@njit(cache=True, error_model="numpy")
def best_places(rows: np.ndarray, fields: np.ndarray, cap: float, own: np.ndarray) -> np.ndarray:
    """Return, for each of m points, the node of the target (m,) int32 with the least cost.

    rows (m, k) float32: metres from each point to each sample, on the source. fields (k, n) float32: metres from each
    sample's place to every node of the target. own (m,) int: the sample that is the point itself, which does not count;
    -1 = none. The cost of a node is the sum, over all samples, of the squared and capped change of the point's distance
    to the sample.
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
    """Place the samples after the first ``known``, then move one sample after another while this reduces the stress.

    a (k, k) float32: distances between the samples. b (n, n) float32: distances between all candidates. places (k,)
    int32 is changed in place.
    """
    costs, most, unmoved = np.empty(len(b), np.float32), np.float32(cap), 0
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
            places[at], unmoved = place, 0
            continue
        unmoved += 1
        if unmoved == len(a):
            break
