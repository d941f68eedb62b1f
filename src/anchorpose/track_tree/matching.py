"""Compute, in compiled code, the match of every node in the next frame, for every subset of the anchors (head, hands
and feet).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from anchorpose.body.nearest_skin import Voxels


class Target(NamedTuple):
    """The nodes of the next frame that may be matched, sorted by the voxels (cubes of space) in which they lie."""

    points_m: np.ndarray  # (n, 3) float32
    distances: np.ndarray  # (n, 5) float32, distances to the anchors


class Balls(NamedTuple):
    """The balls in which matches are searched, one around the expected place of each source node."""

    centres: np.ndarray  # (m, 3) float32
    radius: float
    low: np.ndarray  # (m, 3) int64, the first voxel along each axis that the ball touches
    high: np.ndarray  # (m, 3) int64, the last voxel along each axis; -1 in column 0 if the ball touches no voxel
    order: np.ndarray  # (m,) int64, the source nodes, sorted so that nodes with equal ``low`` and ``high`` are adjacent


class Scratch(NamedTuple):
    """Working memory to find the matches of one node."""

    spots: np.ndarray  # (n,) target nodes in the ball's voxels
    distances: np.ndarray  # (5, n) distances of the nodes in ``spots`` to the anchors
    close: np.ndarray  # (n,) bit set of the anchors to which target node and source node have similar distances
    near: np.ndarray  # (n + 1,) target nodes in the ball
    # (5, n + 1), for each anchor and each target node in the ball (``near``): squared difference between the target
    # node's distance to the anchor and the source node's distance to the anchor
    offset2: np.ndarray
    psi: np.ndarray  # (n + 1,) target nodes that are within the gate of a subset
    distance2: np.ndarray  # (n,) sum of ``offset2`` over the anchors of a subset


def sort_balls(centres: np.ndarray, radius: float, voxels: Voxels) -> Balls:
    """Sort balls of one radius, around centres (m, 3) float32, by the voxels that they touch. With an infinite radius,
    a ball contains all nodes; with a NaN centre, it contains none.
    """
    last_voxel = voxels.shape - 1
    low, high = np.zeros((len(centres), 3), np.int64), np.tile(last_voxel, (len(centres), 1))
    if radius < np.inf:
        places = centres.astype(np.float64)
        first = np.floor((places - radius - voxels.origin_m) / voxels.side_m)
        last = np.floor((places + radius - voxels.origin_m) / voxels.side_m)
        touching = ((last >= 0) & (first <= last_voxel)).all(axis=1)  # false where the centre is NaN
        low[touching] = np.maximum(first[touching], 0)
        high[touching] = np.minimum(last[touching], last_voxel)
        high[~touching, 0] = -1
    order = np.lexsort(np.concatenate([low, high], axis=1).T)
    return Balls(np.ascontiguousarray(centres), float(radius), low, high, order)


def hold_subset(subsets: np.ndarray, anchors: int) -> np.ndarray:
    """Return (2**anchors,) bool: for each set of anchors, coded as bits, whether it contains at least one of the
    subsets (s, n_s).
    """
    needed, held = (1 << subsets).sum(axis=1), np.arange(1 << anchors)
    enough: np.ndarray = ((held[:, None] & needed) == needed).any(axis=1)
    return enough


@njit(cache=True)
def match_all(
    source: np.ndarray,
    limit2: np.ndarray,
    balls: Balls,
    target: Target,
    voxels: Voxels,
    subsets: np.ndarray,
    enough: np.ndarray,
) -> np.ndarray:
    """Return the match (m, s) int32 of each source node under each subset, -1 = none.

    source (m, 5) float32: distances to the anchors; limit2 (m, s) float32: the squared gate (limit on the difference of
    two nodes' distances); subsets (s, n_s) int64; enough: result of ``hold_subset``. Nodes whose balls touch the same
    voxels are processed together, so that the target nodes in these voxels are copied only once.
    """
    match = np.full((len(source), len(subsets)), -1, np.int32)
    low, high, points = balls.low, balls.high, target.points_m
    scratch = _scratch(len(points), source.shape[1])
    psi, laid_out, key = scratch.psi, 0, -1
    for node in balls.order:
        if high[node, 0] < 0:
            continue
        if _key(low[node], high[node], voxels.shape) != key:
            key = _key(low[node], high[node], voxels.shape)
            laid_out = _lay_out(low[node], high[node], voxels, target.distances, scratch)
        picked = _pick(source[node], _largest(limit2[node]), enough, laid_out, scratch)
        count: Any = np.int64(0)
        for c in psi[:picked]:
            scratch.near[count] = scratch.spots[c]
            for k in range(source.shape[1]):
                offset = scratch.distances[k, c] - source[node, k]
                scratch.offset2[k, count] = offset * offset
            count += not _beyond(points, scratch.spots[c], balls, node)
        for s in range(len(subsets)):
            size = _within(scratch.offset2, subsets[s], limit2[node, s], count, scratch.distance2, psi)
            match[node, s] = _middle(points, scratch.near, psi, size, voxels.order)
    return match


@njit(cache=True)
def _pick(source: np.ndarray, largest: np.float32, enough: np.ndarray, laid_out: int, scratch: Scratch) -> int:
    """Find the target nodes that may be within the gate (limit on the difference of distances to anchors) of any
    subset. Fill ``scratch.psi`` with the indices of these nodes in ``scratch.spots``; return their number.

    source (5,) float32: distances of the source node to the anchors; largest: the node's largest squared gate.
    """
    close, psi = scratch.close, scratch.psi
    close[:laid_out] = 0
    for k in range(len(source)):
        _compare(scratch.distances[k], source[k], largest, np.int32(1 << k), close, laid_out)
    picked = 0
    for c in range(laid_out):
        psi[picked] = c
        picked += enough[close[c]]
    return picked


@njit(cache=True)
def _scratch(count: int, anchors: int) -> Scratch:
    spots, close = np.empty(count, np.int32), np.empty(count, np.int32)
    near, psi = np.empty(count + 1, np.int32), np.empty(count + 1, np.int32)
    distances, offset2 = np.empty((anchors, count), np.float32), np.empty((anchors, count + 1), np.float32)
    return Scratch(spots, distances, close, near, offset2, psi, np.empty(count))


@njit(cache=True)
def _largest(limits2: np.ndarray) -> np.float32:
    """Return the largest finite value of ``limits2``, the squared gates of a node under all subsets; 0 if no value is
    finite.
    """
    largest = np.float32(0.0)
    for limit2 in limits2:
        if np.isfinite(limit2):
            largest = max(largest, limit2)
    return largest


@njit(cache=True)
def _lay_out(low: np.ndarray, high: np.ndarray, voxels: Voxels, target: np.ndarray, scratch: Scratch) -> int:
    """Copy the target nodes in the voxels from ``low`` to ``high`` to ``scratch.spots``, and their distances, anchor by
    anchor, to ``scratch.distances``; return the number of nodes.
    """
    start, shape, count = voxels.start, voxels.shape, 0
    spots, distances = scratch.spots, scratch.distances
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            row = (i * shape[1] + j) * shape[2]
            for spot in range(start[row + low[2]], start[row + high[2] + 1]):  # voxels along z are contiguous
                spots[count] = spot
                for k in range(len(distances)):
                    distances[k, count] = target[spot, k]
                count += 1
    return count


@njit(cache=True)
def _compare(
    target: np.ndarray, distance: np.float32, largest: np.float32, bit: np.int32, close: np.ndarray, count: int
) -> None:
    """Mark the target nodes whose distance to an anchor differs from the source node's distance to this anchor by less
    than the gate.
    """
    for c in range(count):
        offset = target[c] - distance
        close[c] |= bit if offset * offset < largest else np.int32(0)  # false for NaN


@njit(cache=True)
def _within(
    offset2: np.ndarray, subset: np.ndarray, limit2: np.float32, count: int, distance2: np.ndarray, psi: np.ndarray
) -> int:
    """Fill ``psi`` with the indices of the nodes in the ball that are within the gate of one subset of anchors; return
    the number of these nodes.
    """
    distance2[:count] = 0.0
    for k in subset:
        for c in range(count):
            distance2[c] += offset2[k, c]
    size = 0
    for c in range(count):
        psi[size] = c
        size += distance2[c] < limit2
    return size


@njit(cache=True)
def _middle(points: np.ndarray, near: np.ndarray, psi: np.ndarray, size: int, order: np.ndarray) -> int:
    """Return the node of the set psi (target nodes within the gate of a subset of anchors) that is nearest to the
    average position of the set, -1 if the set is empty.
    """
    x, y, z = 0.0, 0.0, 0.0
    for m in range(size):
        spot = near[psi[m]]
        x, y, z = x + points[spot, 0], y + points[spot, 1], z + points[spot, 2]
    found, nearest = -1, np.inf
    for m in range(size):
        spot = near[psi[m]]
        away = (points[spot, 0] - x / size) ** 2 + (points[spot, 1] - y / size) ** 2 + (points[spot, 2] - z / size) ** 2
        if away < nearest:
            nearest, found = away, order[spot]
    return found


@njit(cache=True)
def _beyond(points: np.ndarray, spot: int, balls: Balls, node: int) -> bool:
    """Return whether the target node at ``spot`` lies outside the ball of a source node."""
    distance2 = 0.0
    for axis in range(3):
        distance2 += (np.float64(points[spot, axis]) - np.float64(balls.centres[node, axis])) ** 2
    return distance2 > balls.radius * balls.radius


@njit(cache=True)
def _key(low: np.ndarray, high: np.ndarray, shape: np.ndarray) -> int:
    """Return a number that identifies the box of voxels from low to high (3,)."""
    first = (low[0] * shape[1] + low[1]) * shape[2] + low[2]
    last = (high[0] * shape[1] + high[1]) * shape[2] + high[2]
    return first * shape[0] * shape[1] * shape[2] + last
