"""The sub-lists of the reference movements that are most like the last frames (paper, Section IV), exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit

from anchorpose.motion.database import COLUMNS, MotionDatabase, SubLists, poses_at

_SEEDS: Final = 16  # segments searched first, for a cost to beat
_ROUNDED: Final = np.float32(0.9999)  # bounds are kept in single precision, which may round up ...
_SLACK_M: Final = np.float32(1e-5)  # ... and near nothing by more than a share


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """The most similar sub-lists, the best first.

    place (m,) row of the database of the newest pose, stride (m,) rows per frame: see ``SubLists``.
    distance_m (m,): root mean square over the joints, mean over the frames.
    """

    place: np.ndarray
    stride: np.ndarray
    distance_m: np.ndarray

    def poses(self, database: MotionDatabase, frames: np.ndarray) -> np.ndarray:
        """(m, f, d) pose vectors of each match ``frames`` (f,) after its newest pose; negative = before."""
        return poses_at(database.theta, self.place[:, None] + frames * self.stride[:, None])


def best_sublists(
    history: np.ndarray, database: MotionDatabase, steps: int, count: int, displacement_weight: float
) -> Matches | None:
    """The ``count`` sub-lists that are most like the last poses; None where no column is known or no clip long enough.

    The cost is the sum over v of ed(theta^(t-v), theta_s^(j-v)), as in the paper, plus ``displacement_weight`` k times
    the distance of the displacements over the history: a pose alone is passed in both directions and at every speed.
    history (k, d): the newest pose last. Only sub-lists that are followed by ``steps`` more frames count. What a lower
    bound keeps from being among the best is skipped, so the result is exact: k distances sum up to at least k
    times that of the means, and columns left out shorten both. Ties go to the earlier sub-list. A column that is
    missing anywhere in the history is not compared, and then every sub-list is tested.
    """
    k, listed = len(history), database.sublists
    known = np.flatnonzero(np.isfinite(history[:, : database.compared]).all(axis=0))
    if not len(known):
        return None
    if len(known) == database.compared:
        recent = history[:, : database.compared] @ database.basis.astype(np.float64)
        leading = recent[:, :COLUMNS]
        query = np.stack([leading.mean(axis=0), leading[-1] - leading[0]]).astype(np.float32)
        columns = database.turned
    else:
        columns, recent, query = np.ascontiguousarray(database.theta[:, known]), history[:, known], None
    recent = np.ascontiguousarray(recent, dtype=np.float32)
    chosen, cost = _rank(columns, recent, query, listed, steps, count, displacement_weight)
    if not len(chosen):
        return None
    return Matches(listed.place[chosen], listed.stride[chosen], cost / k / float(np.sqrt(len(known) / 3.0)))


@njit(cache=True)
def _rank(
    theta: np.ndarray,
    history: np.ndarray,
    query: np.ndarray | None,
    sublists: SubLists,
    steps: int,
    count: int,
    displacement_weight: float,
) -> tuple[np.ndarray, np.ndarray]:
    """The best sub-lists by rising cost. Without ``query``, which has a summary's shape, there are no bounds."""
    best, cost = np.full(count, -1, dtype=np.int64), np.full(count, np.inf)
    place, stride, followed, segment = sublists.place, sublists.stride, sublists.followed, sublists.segment
    found = 0
    scale, weight = np.float32(len(history)) * _ROUNDED, np.float32(displacement_weight)
    bound = np.zeros(len(segment) - 1, dtype=np.float32)
    seeds = np.zeros(0, dtype=np.int64)
    if query is not None:
        seeds = _bound_segments(sublists.centre, sublists.radius, query, scale, weight, bound)
    for turn in range(len(seeds) + len(bound)):
        s = seeds[turn] if turn < len(seeds) else turn - len(seeds)
        if bound[s] < 0 or bound[s] > cost[-1]:
            continue
        bound[s] = -1.0  # done
        for w in range(segment[s], segment[s + 1]):
            if followed[w] < steps:
                continue
            if query is not None and scale * _apart(sublists.summary[w], query, weight) - _SLACK_M > cost[-1]:
                continue
            total = _cost(theta, history, place[w], stride[w], displacement_weight, cost[-1])
            found = _insert(best, cost, found, w, total)
    return best[:found], cost[:found]


@njit(cache=True)
def _insert(best: np.ndarray, cost: np.ndarray, found: int, w: int, total: float) -> int:
    """Put a sub-list in its place among the best if it belongs there; returns how many there are now."""
    if found == len(best):
        if total > cost[-1] or (total == cost[-1] and w > best[-1]):
            return found
        found -= 1
    spot = found
    while spot > 0 and (cost[spot - 1] > total or (cost[spot - 1] == total and best[spot - 1] > w)):
        best[spot], cost[spot] = best[spot - 1], cost[spot - 1]
        spot -= 1
    best[spot], cost[spot] = w, total
    return found + 1


@njit(cache=True, fastmath=True)
def _apart(summary: np.ndarray, query: np.ndarray, weight: np.float32) -> np.float32:
    pose, moved = np.float32(0.0), np.float32(0.0)
    for column in range(summary.shape[1]):
        pose += (summary[0, column] - query[0, column]) ** 2
        moved += (summary[1, column] - query[1, column]) ** 2
    return np.sqrt(pose) + weight * np.sqrt(moved)


@njit(cache=True, fastmath=True)
def _bound_segments(
    centre: np.ndarray, radius: np.ndarray, query: np.ndarray, scale: np.float32, weight: np.float32, bound: np.ndarray
) -> np.ndarray:
    """Fill ``bound``: no sub-list of a segment costs less. Returns the segments whose centres are nearest."""
    nearest = np.full(min(_SEEDS, len(centre)), -1, dtype=np.int64)
    reach = np.full(len(nearest), np.float32(3.4e38), dtype=np.float32)
    for s in range(len(centre)):
        pose, moved = np.float32(0.0), np.float32(0.0)
        for column in range(centre.shape[2]):
            pose += (centre[s, 0, column] - query[0, column]) ** 2
            moved += (centre[s, 1, column] - query[1, column]) ** 2
        pose, moved = np.sqrt(pose), np.sqrt(moved)
        away = pose + weight * moved
        pose, moved = max(np.float32(0.0), pose - radius[s, 0]), max(np.float32(0.0), moved - radius[s, 1])
        bound[s] = max(np.float32(0.0), scale * (pose + weight * moved) - _SLACK_M)
        if away < reach[-1]:
            spot = len(reach) - 1
            while spot > 0 and reach[spot - 1] > away:
                nearest[spot], reach[spot] = nearest[spot - 1], reach[spot - 1]
                spot -= 1
            nearest[spot], reach[spot] = s, away
    return nearest


@njit(cache=True)
def _cost(
    theta: np.ndarray, history: np.ndarray, place: float, stride: float, displacement_weight: float, limit: float
) -> float:
    """The cost of one sub-list, or infinity as soon as it is above ``limit``."""
    k, d = history.shape
    last = len(theta) - 1
    new, old = int(place), int(place - (k - 1) * stride)
    a, b = np.float32(place - new), np.float32(place - (k - 1) * stride - old)
    squared = np.float32(0.0)
    for column in range(d):
        moved = theta[new, column] + a * (theta[min(new + 1, last), column] - theta[new, column])
        moved -= theta[old, column] + b * (theta[old + 1, column] - theta[old, column])
        squared += (moved - (history[k - 1, column] - history[0, column])) ** 2
    total = displacement_weight * k * np.sqrt(squared)
    for back in range(k):
        if total > limit:
            return np.inf
        at = place - back * stride
        low = int(at)
        share, high = np.float32(at - low), min(low + 1, last)
        squared = np.float32(0.0)
        for column in range(d):
            squared += (
                theta[low, column] + share * (theta[high, column] - theta[low, column]) - history[k - 1 - back, column]
            ) ** 2
        total += np.sqrt(squared)
    return total if total <= limit else np.inf
