"""Find the nodes within a radius of each node, for descriptors of the surface around a node."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

# Number of successive nodes that are skipped together if they are far away: about as many as a row of the mesh has on a
# limb
BLOCK: Final = 32


class Neighbours(NamedTuple):
    """The nodes around each node, by ascending number, without the node itself.

    The nodes within ``radius_m`` of node c are ``node[start[c]:start[c + 1]]``. A node without a position has no
    neighbours and is never a neighbour.
    """

    start: np.ndarray  # (n + 1,) int64
    node: np.ndarray  # (m,) int32
    distance2_m2: np.ndarray  # (m,) float32, squared distance to each of these nodes
    radius_m: float


def find_neighbours(points_m: np.ndarray, radius_m: float) -> Neighbours:
    """Return all nodes within a radius of each node, including nodes exactly at this distance.

    points_m (n, 3), any frame; NaN where unknown. Raises ValueError on a radius that is not positive and finite.
    """
    require_radius(radius_m)
    points = as_points(points_m, "points_m")
    start, node, distance2 = _within(points, radius_m)
    return Neighbours(start, node, distance2, float(radius_m))


@njit(cache=True)
def _within(points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the arrays start, node and squared distance of ``Neighbours``.

    Successive nodes of a mesh lie side by side, so whole blocks of successive nodes can be skipped if they are far
    away. The result is in ascending order, unlike the result of a search tree.
    """
    low, high = _boxes(points)
    limit, count = radius * radius, len(points)
    start = np.zeros(count + 1, np.int64)
    node, distance2 = np.empty(64 * count, np.int32), np.empty(64 * count, np.float32)
    spot = 0
    for c in range(count):
        if spot + count > len(node):
            node, distance2 = longer(node, count), longer(distance2, count)
        x, y, z = np.float64(points[c, 0]), np.float64(points[c, 1]), np.float64(points[c, 2])
        for block in range(len(low)):
            dx = max(low[block, 0] - x, x - high[block, 0], 0.0)
            dy = max(low[block, 1] - y, y - high[block, 1], 0.0)
            dz = max(low[block, 2] - z, z - high[block, 2], 0.0)
            if dx * dx + dy * dy + dz * dz > limit:
                continue
            for other in range(block * BLOCK, min((block + 1) * BLOCK, count)):
                dx, dy, dz = points[other, 0] - x, points[other, 1] - y, points[other, 2] - z
                apart2 = dx * dx + dy * dy + dz * dz
                # the entry is kept only if the node is near; if not, the next node overwrites it
                node[spot], distance2[spot] = other, apart2
                spot += (apart2 <= limit) & (other != c)
        start[c + 1] = spot
    return start, node[:spot].copy(), distance2[:spot].copy()


@njit(cache=True)
def _boxes(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest coordinates (b, 3) float64 of blocks of nodes.

    The coordinates are inf and -inf if no node of the block has a position.
    """
    blocks = (len(points) + BLOCK - 1) // BLOCK
    low, high = np.full((blocks, 3), np.inf), np.full((blocks, 3), -np.inf)
    for node in range(len(points)):
        for axis in range(3):
            value = np.float64(points[node, axis])
            if value < low[node // BLOCK, axis]:
                low[node // BLOCK, axis] = value
            if value > high[node // BLOCK, axis]:
                high[node // BLOCK, axis] = value
    return low, high


@njit(cache=True)
def longer(array: np.ndarray, extra: int) -> np.ndarray:
    """Return a copy of the array with more space: twice the length of the array plus ``extra``; the entries after the
    copied entries have arbitrary values.
    """
    room = np.empty(2 * len(array) + extra, array.dtype)
    room[: len(array)] = array
    return room


def count_within(points_m: np.ndarray, radius_m: float) -> np.ndarray:
    """Return (n,) int32: number of nodes within a radius of each node (n, 3), including the node itself.

    The number is 0 for a node without position.
    """
    require_radius(radius_m)
    points = as_points(points_m, "points_m")
    known = np.isfinite(points).all(axis=1)
    count = np.zeros(len(points), np.int32)
    count[known] = cKDTree(points[known]).query_ball_point(points[known], radius_m, return_length=True)
    return count


def require_radius(radius_m: float) -> None:
    if not 0.0 < radius_m < np.inf:
        raise ValueError(f"a radius must be positive and finite, got {radius_m}")


def as_points(values: np.ndarray, name: str) -> np.ndarray:
    """Return points as a contiguous array (n, 3) float32; raises ValueError for another shape."""
    values = np.ascontiguousarray(values, np.float32)
    if values.ndim != 2 or values.shape[1] != 3:
        raise ValueError(f"{name} must have shape (n, 3), got {values.shape}")
    return values


def as_oriented(points_m: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and normals as ``as_points`` makes them; raises ValueError if their numbers differ."""
    points, unit = as_points(points_m, "points_m"), as_points(normals, "normals")
    if len(points) != len(unit):
        raise ValueError(f"{len(points)} points, but {len(unit)} normals")
    return points, unit
