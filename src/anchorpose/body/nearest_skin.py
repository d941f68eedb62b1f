"""Find, for each node of the seen surface, the nearest skin point that faces the same way; a grid of cells makes the
search fast.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit

# approximate maximum number of voxels; so many voxels take 8 MB of memory. If the nodes extend over more space than a
# room, the voxels are made larger, so that their number hardly exceeds this maximum
MAX_VOXELS: Final = 1_000_000


class Voxels(NamedTuple):
    """Nodes (points of the seen surface) sorted into voxels, which are cubes of one size."""

    order: np.ndarray  # (n,) int32, indices of the nodes, sorted by voxel
    start: np.ndarray  # (x * y * z + 1,) int32, where each voxel begins in ``order``
    origin_m: np.ndarray  # (3,) float64, lowest corner of the first voxel
    side_m: float  # length of a voxel's side
    shape: np.ndarray  # (3,) int64, number of voxels along each axis: x, y, z


def sort_into_voxels(points_m: np.ndarray, radius_m: float) -> Voxels:
    """Sort points (n, 3), n > 0, into voxels half as wide as the search radius; an infinite radius gives one voxel."""
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
    """Sort points (n, 3) float64 into voxels, and return the arrays ``order`` and ``start`` of ``Voxels``; points keep
    their order within a voxel.
    """
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


# m, side of a cell of the grid; a cell holds a few skin points, while smaller cells would often be empty and cost time
CELL_M: Final = 0.08


class Oriented(NamedTuple):
    """The points of a surface with their normals."""

    places_m: np.ndarray  # (n, 3) m, places of the points in the world
    normals: np.ndarray  # (n, 3) unit normals


class Grid(NamedTuple):
    """Points of a surface, sorted by the cell of the grid in which they lie, contiguous in memory."""

    order: np.ndarray  # (k,) index of each point before sorting
    skin: np.ndarray  # (k, 6) place and normal of each point
    start: np.ndarray  # index in ``order`` where each cell begins
    origin: np.ndarray  # (3,) lowest corner of the first cell
    shape: np.ndarray  # (3,) number of cells along each axis


@njit(cache=True, nogil=True)
def nearest_facing(
    skin: Oriented, nodes: Oriented, seen_from: np.ndarray, eyes: np.ndarray, reach: float, normal_weight: float
) -> np.ndarray:
    """Return the skin point (n,) int64 nearest to each node (point of the seen surface), -1 if no skin point is nearer
    than reach.

    Only skin that faces the node's camera is used. The distance is computed between vectors of six numbers: the place,
    and the normal times ``normal_weight``. seen_from (n,): the camera that saw each node; eyes (c, 3): the cameras'
    positions. The result is exact: the search skips only cells that are farther away than the best point so far. The
    search for each node begins with the skin point found for the previous node.
    """
    nearest = np.full(len(nodes.places_m), -1, np.int64)
    for camera in range(len(eyes)):
        facing = _facing(skin, eyes[camera])
        if not len(facing):
            continue
        grid, spot = _grid(skin, facing), 0
        for node in range(len(nodes.places_m)):
            if seen_from[node] != camera:
                continue
            best = reach * reach
            away = _distance2(grid.skin, spot, nodes, node, normal_weight)
            found = spot if away < best else -1
            better = _search(grid, nodes, node, normal_weight, min(away, best))
            found = better if better >= 0 else found
            if found >= 0:
                nearest[node], spot = grid.order[found], found
    return nearest


@njit(cache=True, nogil=True)
def facing_rows(
    skin: Oriented,
    nodes: Oriented,
    seen_from: np.ndarray,
    eyes: np.ndarray,
    reach: float,
    normal_weight: float,
    uncovered: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the index of the skin point (m,), the index of the node (m,) and the unit direction of the pull (m, 3) for
    every node with a skin point within reach.

    The direction of the pull is the mean of the normals of node and skin point. If node and skin point are farther
    apart than ``uncovered``, the direction is along the line between them.
    """
    nearest = nearest_facing(skin, nodes, seen_from, eyes, reach, normal_weight)
    point, found, count = np.empty(len(nearest), np.int64), np.empty(len(nearest), np.int64), 0
    direction, offset = np.empty((len(nearest), 3)), np.empty(3)
    for node in range(len(nearest)):
        p = nearest[node]
        if p < 0:
            continue
        away, squared = 0.0, 0.0
        for i in range(3):
            offset[i] = skin.places_m[p, i] - nodes.places_m[node, i]
            direction[count, i] = nodes.normals[node, i] + skin.normals[p, i]
            away += offset[i] ** 2
            squared += direction[count, i] ** 2
        straight = away > uncovered * uncovered
        length = max(np.sqrt(away if straight else squared), 1e-9)
        for i in range(3):  # loops instead of slices, which would take seconds to compile
            direction[count, i] = (offset[i] if straight else direction[count, i]) / length
        point[count], found[count] = p, node
        count += 1
    return point[:count].copy(), found[:count].copy(), direction[:count].copy()


@njit(cache=True, nogil=True)
def nearest_point(points: np.ndarray, nodes: np.ndarray, reach: float) -> np.ndarray:
    """Return (n,) int64: the point (p, 3) nearest to each node (n, 3), whatever their normals; -1 if no point is within
    reach.
    """
    nearest = np.full(len(nodes), -1, np.int64)
    grid, places = _grid(Oriented(points, points), np.arange(len(points))), Oriented(nodes, nodes)
    for node in range(len(nodes)):
        found = _search(grid, places, node, 0.0, reach * reach)
        nearest[node] = grid.order[found] if found >= 0 else -1
    return nearest


@njit(cache=True, nogil=True)
def _facing(skin: Oriented, eye: np.ndarray) -> np.ndarray:
    """Return the indices of the points whose outer side faces the camera at ``eye``."""
    facing, count = np.empty(len(skin.places_m), np.int64), 0
    for p in range(len(skin.places_m)):
        towards = 0.0
        for axis in range(3):
            towards += (eye[axis] - skin.places_m[p, axis]) * skin.normals[p, axis]
        if towards > 0.0:
            facing[count] = p
            count += 1
    return facing[:count]


@njit(cache=True, nogil=True)
def _grid(surface: Oriented, chosen: np.ndarray) -> Grid:
    """Return the chosen points as a ``Grid``, sorted by cell."""
    points = surface.places_m
    origin, top = points[chosen[0]].copy(), points[chosen[0]].copy()
    for p in chosen:
        for axis in range(3):
            origin[axis] = min(origin[axis], points[p, axis])
            top[axis] = max(top[axis], points[p, axis])
    shape = np.empty(3, np.int64)
    for axis in range(3):
        shape[axis] = int((top[axis] - origin[axis]) / CELL_M) + 1
    by_cell, start = sort_by_cell(points[chosen], origin, CELL_M, shape)
    order, skin = chosen[by_cell], np.empty((len(chosen), 6))
    for k in range(len(order)):
        for axis in range(3):
            skin[k, axis], skin[k, 3 + axis] = points[order[k], axis], surface.normals[order[k], axis]
    return Grid(order, skin, start, origin, shape)


@njit(cache=True, nogil=True)
def _distance2(skin: np.ndarray, spot: int, nodes: Oriented, node: int, normal_weight: float) -> float:
    away, turned = 0.0, 0.0
    for axis in range(3):
        away += (skin[spot, axis] - nodes.places_m[node, axis]) ** 2
        turned += (skin[spot, 3 + axis] - nodes.normals[node, axis]) ** 2
    return away + normal_weight * normal_weight * turned


@njit(cache=True, nogil=True)
def _search(grid: Grid, nodes: Oriented, node: int, normal_weight: float, best: float) -> int:
    """Return the row of ``grid.skin`` that is nearest to a node, or -1 if the squared distance of every row is at least
    ``best``.

    The node's own cell is searched first, since a point found there narrows the search in the cells around it.
    """
    skin, start, shape, found = grid.skin, grid.start, grid.shape, -1
    origin = grid.origin
    x, y = nodes.places_m[node, 0] - origin[0], nodes.places_m[node, 1] - origin[1]
    z = nodes.places_m[node, 2] - origin[2]
    i, j, k = int(np.floor(x / CELL_M)), int(np.floor(y / CELL_M)), int(np.floor(z / CELL_M))
    if 0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= k < shape[2]:
        own = (i * shape[1] + j) * shape[2] + k
        for spot in range(start[own], start[own + 1]):
            distance = _distance2(skin, spot, nodes, node, normal_weight)
            if distance < best:
                best, found = distance, spot
    left, right = _cells_within(x, np.sqrt(best), shape[0])
    low, high = _cells_within(y, np.sqrt(best), shape[1])
    for i in range(left, right + 1):
        for j in range(low, high + 1):
            left_over = best - _gap(x, i) ** 2 - _gap(y, j) ** 2
            if left_over <= 0.0:
                continue
            first, last = _cells_within(z, np.sqrt(left_over), shape[2])
            if first > last:
                continue
            row = (i * shape[1] + j) * shape[2]
            # the points of cells that follow one another along z are in successive rows of the grid
            for spot in range(start[row + first], start[row + last + 1]):
                distance = _distance2(skin, spot, nodes, node, normal_weight)
                if distance < best:
                    best, found = distance, spot
    return found


@njit(cache=True, nogil=True)
def _cells_within(place: float, radius: float, count: int) -> tuple[int, int]:
    """Return the first and the last cell, along one axis, that are within a radius of a place."""
    first, last = int(np.floor((place - radius) / CELL_M)), int(np.floor((place + radius) / CELL_M))
    return max(0, first), min(count - 1, last)


@njit(cache=True, nogil=True)
def _gap(place: float, cell: int) -> float:
    """Return the distance from a place to a cell along one axis, 0 within the cell."""
    return max(cell * CELL_M - place, place - (cell + 1) * CELL_M, 0.0)
