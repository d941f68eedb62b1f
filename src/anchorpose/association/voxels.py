"""Surface nodes sorted into voxels, so that a ball is searched without searching the whole body."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit

MAX_VOXELS: Final = 1_000_000  # 8 MB of row starts; nodes spread wider than a room get coarser voxels


class Voxels(NamedTuple):
    """order (n,) int32: nodes, voxel after voxel; start (x * y * z + 1,) int32: where each voxel begins in it.

    origin_m (3,) float64: lowest corner of the first voxel; side_m: length of a side; shape (3,) int64.
    """

    order: np.ndarray
    start: np.ndarray
    origin_m: np.ndarray
    side_m: float
    shape: np.ndarray


def sort_into_voxels(points_m: np.ndarray, radius_m: float) -> Voxels:
    """Voxels of half the search radius for points (n, 3), n > 0; an infinite radius gives one voxel."""
    origin = points_m.min(axis=0).astype(np.float64)
    extent = points_m.max(axis=0).astype(np.float64) - origin
    if not np.isfinite(extent).all():
        raise ValueError("the surface has nodes whose position is not finite")
    side = radius_m / 2.0 if np.isfinite(radius_m) else float(extent.max()) + 1.0
    side = max(side, float((extent.prod() / MAX_VOXELS) ** (1 / 3)))
    shape = (extent // side).astype(np.int64) + 1
    order, start = sort_by_cell(points_m.astype(np.float64), origin, side, shape)
    return Voxels(order=order, start=start, origin_m=origin, side_m=side, shape=shape)


@njit(cache=True)
def sort_by_cell(
    points: np.ndarray, origin: np.ndarray, side: float, shape: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Order and start of ``Voxels`` for points (n, 3) float64; within a voxel the nodes keep their order."""
    cell, start = np.empty(len(points), np.int64), np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int32)
    for node in range(len(points)):
        spot = 0
        for axis in range(3):
            along = int(np.floor((points[node, axis] - origin[axis]) / side))
            spot = spot * shape[axis] + min(along, shape[axis] - 1)
        cell[node] = spot
        start[spot + 1] += 1
    for spot in range(len(start) - 1):
        start[spot + 1] += start[spot]
    order, filled = np.empty(len(points), np.int32), start[:-1].copy()
    for node in range(len(points)):
        order[filled[cell[node]]] = node
        filled[cell[node]] += 1
    return order, start
