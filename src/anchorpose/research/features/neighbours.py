"""Who is within a radius of whom: found once, shared by every descriptor of that radius."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from anchorpose.association.voxels import sort_into_voxels


@dataclass(frozen=True, slots=True, eq=False)
class Neighbours:
    """The nodes around each centre, itself left out, in no particular order.

    centre (k,) int32: a node number each; those within ``radius_m`` of centre c are ``node[start[c]:start[c + 1]]``,
    start (k + 1,) int64, node (m,) int32, at squared distances distance2_m2 (m,) float32. A centre whose position is
    not known has none, and such a node is nobody's neighbour. points: how many nodes were searched.
    """

    centre: np.ndarray
    start: np.ndarray
    node: np.ndarray
    distance2_m2: np.ndarray
    radius_m: float
    points: int

    def __len__(self) -> int:
        return len(self.centre)


def find_neighbours(points_m: np.ndarray, radius_m: float, chosen: np.ndarray | None = None) -> Neighbours:
    """Everybody within a radius, the sphere itself included, of the chosen nodes (k,) int, or of all (None).

    points_m (n, 3), any frame; NaN where not known. 8 bytes for each pair: 90 MB where 15,000 nodes have 740 each.
    Raises ValueError on a radius that is not positive and finite, and on node numbers that do not exist.
    """
    require_radius(radius_m)
    points, centre = as_points(points_m, "points_m"), as_chosen(chosen, len(points_m))
    known = np.flatnonzero(np.isfinite(points).all(axis=1)).astype(np.int32)
    if len(known) == 0 or len(centre) == 0:
        start, nobody = np.zeros(len(centre) + 1, np.int64), np.empty(0, np.int32)
        return Neighbours(centre, start, nobody, np.empty(0, np.float32), radius_m, len(points))
    voxels = sort_into_voxels(points[known], radius_m)
    order = known[voxels.order]
    place = np.ascontiguousarray(points[order].T)
    grid = (voxels.start, voxels.origin_m, voxels.side_m, voxels.shape)
    start = _count(place, points, centre, radius_m, *grid)
    node, distance2 = _list(place, order, points, centre, start, radius_m, *grid)
    return Neighbours(centre, start, node, distance2, radius_m, len(points))


def count_within(points_m: np.ndarray, radius_m: float) -> np.ndarray:
    """(n,) int32: how many nodes are within a radius of each node (n, 3), itself included; 0 where it is not known."""
    require_radius(radius_m)
    points = as_points(points_m, "points_m")
    known = np.isfinite(points).all(axis=1)
    count = np.zeros(len(points), np.int32)
    if known.any():
        voxels = sort_into_voxels(points[known], radius_m)
        place = np.ascontiguousarray(points[known][voxels.order].T)
        grid = (voxels.start, voxels.origin_m, voxels.side_m, voxels.shape)
        centre = np.flatnonzero(known).astype(np.int32)
        count[known] = np.diff(_count(place, points, centre, radius_m, *grid)) + 1
    return count


def shared_or_found(
    neighbours: Neighbours | None, points_m: np.ndarray, radius_m: float, chosen: np.ndarray | None
) -> Neighbours:
    """The neighbours that a caller shares between descriptors, or new ones; ValueError where they are another's."""
    if neighbours is None:
        return find_neighbours(points_m, radius_m, chosen)
    if neighbours.points != len(points_m) or neighbours.radius_m != radius_m:
        raise ValueError(
            f"neighbours of {neighbours.points} nodes within {neighbours.radius_m} m are not those of "
            f"{len(points_m)} nodes within {radius_m} m"
        )
    if not np.array_equal(neighbours.centre, as_chosen(chosen, len(points_m))):
        raise ValueError("the neighbours are not those of the chosen nodes")
    return neighbours


def require_radius(radius_m: float) -> None:
    if not 0.0 < radius_m < np.inf:
        raise ValueError(f"a radius must be positive and finite, got {radius_m}")


def as_points(values: np.ndarray, name: str) -> np.ndarray:
    """(n, 3) float32 in one block; ValueError on another shape."""
    values = np.ascontiguousarray(values, np.float32)
    if values.ndim != 2 or values.shape[1] != 3:
        raise ValueError(f"{name} must have shape (n, 3), got {values.shape}")
    return values


def as_chosen(chosen: np.ndarray | None, count: int) -> np.ndarray:
    """(k,) int32 node numbers, all of them for None; IndexError is not left to a kernel: ValueError."""
    if chosen is None:
        return np.arange(count, dtype=np.int32)
    numbers = np.atleast_1d(np.asarray(chosen))
    if numbers.ndim != 1 or (numbers.size and not np.issubdtype(numbers.dtype, np.integer)):
        raise ValueError(f"chosen must be node numbers (k,), got {numbers.dtype} of shape {numbers.shape}")
    if numbers.size and not (numbers.min() >= 0 and numbers.max() < count):
        raise ValueError(f"chosen names nodes that are not among the {count}")
    return numbers.astype(np.int32)


@njit(cache=True)
def _voxel_range(at: float, radius: float, origin: float, side: float, count: int) -> tuple[int, int]:
    low, high = np.floor((at - radius - origin) / side), np.floor((at + radius - origin) / side)
    return max(0, int(low)), min(count - 1, int(high))


@njit(cache=True)
def _count(
    place: np.ndarray, points: np.ndarray, centre: np.ndarray, radius: float,
    first: np.ndarray, origin: np.ndarray, side: float, shape: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """(k + 1,) int64: where the neighbours of each centre will begin."""
    start, radius2 = np.zeros(len(centre) + 1, np.int64), np.float32(radius) * np.float32(radius)
    for c in range(len(centre)):
        x, y, z = points[centre[c], 0], points[centre[c], 1], points[centre[c], 2]
        count = np.int32(0)
        if np.isfinite(x + y + z):
            low_i, high_i = _voxel_range(x, radius, origin[0], side, shape[0])
            low_j, high_j = _voxel_range(y, radius, origin[1], side, shape[1])
            low_k, high_k = _voxel_range(z, radius, origin[2], side, shape[2])
            for i in range(low_i, high_i + 1):
                for j in range(low_j, high_j + 1):
                    row = (i * shape[1] + j) * shape[2]
                    for spot in range(first[row + low_k], first[row + high_k + 1]):  # voxels along z follow one another
                        dx, dy, dz = place[0, spot] - x, place[1, spot] - y, place[2, spot] - z
                        count += np.int32(dx * dx + dy * dy + dz * dz <= radius2)
            count -= 1  # itself
        start[c + 1] = start[c] + count
    return start


@njit(cache=True)
def _list(
    place: np.ndarray, order: np.ndarray, points: np.ndarray, centre: np.ndarray, start: np.ndarray, radius: float,
    first: np.ndarray, origin: np.ndarray, side: float, shape: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """node and distance2_m2 of ``Neighbours``; whoever is looked at is written, and stays if he is near."""
    node, distance2 = np.empty(start[-1] + 1, np.int32), np.empty(start[-1] + 1, np.float32)
    radius2 = np.float32(radius) * np.float32(radius)
    for c in range(len(centre)):
        own, filled = centre[c], start[c]
        x, y, z = points[own, 0], points[own, 1], points[own, 2]
        if not np.isfinite(x + y + z):
            continue
        low_i, high_i = _voxel_range(x, radius, origin[0], side, shape[0])
        low_j, high_j = _voxel_range(y, radius, origin[1], side, shape[1])
        low_k, high_k = _voxel_range(z, radius, origin[2], side, shape[2])
        for i in range(low_i, high_i + 1):
            for j in range(low_j, high_j + 1):
                row = (i * shape[1] + j) * shape[2]
                for spot in range(first[row + low_k], first[row + high_k + 1]):
                    dx, dy, dz = place[0, spot] - x, place[1, spot] - y, place[2, spot] - z
                    away2 = dx * dx + dy * dy + dz * dz
                    node[filled], distance2[filled] = order[spot], away2
                    filled += (away2 <= radius2) & (order[spot] != own)
    return node[:-1], distance2[:-1]
