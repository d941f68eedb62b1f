"""The match of every node under every subset of anchors, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def match_all(
    source: np.ndarray,
    limit2: np.ndarray,
    centres: np.ndarray,
    points: np.ndarray,
    target: np.ndarray,
    order: np.ndarray,
    start: np.ndarray,
    origin: np.ndarray,
    side: float,
    shape: np.ndarray,
    radius: float,
    subsets: np.ndarray,
) -> np.ndarray:
    """Nodes whose balls touch the same voxels go one after another, so that these are laid out once for all of them."""
    match = np.full((len(source), len(subsets)), -1, np.int32)
    enough = _holding(subsets, source.shape[1])
    low, high = _voxel_ranges(centres, radius, origin, side, shape)
    spots, distances = np.empty(len(points), np.int32), np.empty((source.shape[1], len(points)), np.float32)
    near, psi = np.empty(len(points) + 1, np.int32), np.empty(len(points) + 1, np.int32)
    close, distance2 = np.empty(len(points), np.int32), np.empty(len(points))
    offset2 = np.empty((source.shape[1], len(points) + 1), np.float32)
    laid_out, key = 0, -1
    for node in _by_voxels(low, high, shape):
        if high[node, 0] < 0:
            continue
        if _key(low[node], high[node], shape) != key:
            key = _key(low[node], high[node], shape)
            laid_out = _lay_out(low[node], high[node], start, shape, target, spots, distances)
        largest = np.float32(0.0)
        for s in range(len(subsets)):
            if np.isfinite(limit2[node, s]):
                largest = max(largest, limit2[node, s])
        close[:laid_out] = 0
        for k in range(source.shape[1]):
            _compare(distances[k], source[node, k], largest, np.int32(1 << k), close, laid_out)
        picked = 0
        for c in range(laid_out):
            psi[picked] = c
            picked += enough[close[c]]
        count = 0
        for c in psi[:picked]:
            near[count] = spots[c]
            for k in range(source.shape[1]):
                offset = distances[k, c] - source[node, k]
                offset2[k, count] = offset * offset
            count += not _beyond(points, spots[c], centres, node, radius)
        for s in range(len(subsets)):
            size = _within(offset2, subsets[s], limit2[node, s], count, distance2, psi)
            match[node, s] = _middle(points, near, psi, size, order)
    return match


@njit(cache=True)
def _holding(subsets: np.ndarray, anchors: int) -> np.ndarray:
    """Of each set of anchors, a bit each, whether it holds one of the subsets."""
    enough = np.zeros(1 << anchors, np.bool_)
    for s in range(len(subsets)):
        needed = 0
        for k in subsets[s]:
            needed |= 1 << k
        for held in range(len(enough)):
            enough[held] |= held & needed == needed
    return enough


@njit(cache=True)
def _lay_out(
    low: np.ndarray, high: np.ndarray, start: np.ndarray, shape: np.ndarray, target: np.ndarray, spots: np.ndarray,
    distances: np.ndarray,
) -> int:  # fmt: skip
    """Fills spots with the target nodes of some voxels, and distances with theirs, anchor by anchor; how many."""
    count = 0
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            row = (i * shape[1] + j) * shape[2]
            for spot in range(start[row + low[2]], start[row + high[2] + 1]):  # voxels along z follow one another
                spots[count] = spot
                for k in range(len(distances)):
                    distances[k, count] = target[spot, k]
                count += 1
    return count


@njit(cache=True)
def _compare(
    target: np.ndarray, distance: np.float32, largest: np.float32, bit: np.int32, close: np.ndarray, count: int
) -> None:
    """Marks the target nodes that are as far from one anchor as the source node, but for a gate's width."""
    for c in range(count):
        offset = target[c] - distance
        close[c] |= bit if offset * offset < largest else np.int32(0)  # never where it is NaN


@njit(cache=True)
def _within(
    offset2: np.ndarray, subset: np.ndarray, limit2: np.float32, count: int, distance2: np.ndarray, psi: np.ndarray
) -> int:
    """Fills psi with those of the near nodes that are within the gate of one subset; returns how many."""
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
    """The member of psi nearest to their average, -1 where there is none."""
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
def _beyond(points: np.ndarray, spot: int, centres: np.ndarray, node: int, radius: float) -> bool:
    distance2 = 0.0
    for axis in range(3):
        distance2 += (np.float64(points[spot, axis]) - np.float64(centres[node, axis])) ** 2
    return distance2 > radius * radius


@njit(cache=True)
def _voxel_ranges(
    centres: np.ndarray, radius: float, origin: np.ndarray, side: float, shape: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The first and last voxels (m, 3) that each ball touches; last -1 where it misses all of them or has no centre."""
    low, high = np.zeros((len(centres), 3), np.int64), np.full((len(centres), 3), -1, np.int64)
    for node in range(len(centres)):
        for axis in range(3):
            last_voxel = shape[axis] - 1
            if radius < np.inf:
                first = np.floor((centres[node, axis] - radius - origin[axis]) / side)
                last = np.floor((centres[node, axis] + radius - origin[axis]) / side)
                if not (last >= 0 and first <= last_voxel):  # also where the centre is NaN
                    high[node, 0] = -1
                    break
                low[node, axis], high[node, axis] = max(0, int(first)), min(last_voxel, int(last))
            else:
                high[node, axis] = last_voxel
    return low, high


@njit(cache=True)
def _key(low: np.ndarray, high: np.ndarray, shape: np.ndarray) -> int:
    first = (low[0] * shape[1] + low[1]) * shape[2] + low[2]
    last = (high[0] * shape[1] + high[1]) * shape[2] + high[2]
    return first * shape[0] * shape[1] * shape[2] + last


@njit(cache=True)
def _by_voxels(low: np.ndarray, high: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """(m,) the nodes, those of the same voxels together."""
    keys = np.empty(len(low), np.int64)
    for node in range(len(low)):
        keys[node] = _key(low[node], high[node], shape)
    return np.argsort(keys)
