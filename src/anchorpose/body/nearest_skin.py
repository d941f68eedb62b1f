"""Which skin point each node pulls: the nearest in place and normal among those that face the node's camera."""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.association.voxels import sort_by_cell

CELL_M = 0.04  # a skin point or two a cell: a node's own neighbourhood is then a few dozen candidates


@njit(cache=True)
def nearest_facing(
    points: np.ndarray, normals: np.ndarray, nodes: np.ndarray, node_normals: np.ndarray, seen_from: np.ndarray,
    eyes: np.ndarray, reach: float, normal_weight: float,
) -> np.ndarray:  # fmt: skip
    """(n,) int64 skin point of each node, -1 where none is nearer than reach.

    The distance is that of place and ``normal_weight`` times normal, six numbers. points, normals (p, 3): skin; nodes,
    node_normals (n, 3) and seen_from (n,): the camera that saw it; eyes (c, 3) where the cameras are. Exact: cells that
    are farther off than the best found so far are left out, and the match of the node before is the first guess.
    """
    nearest = np.full(len(nodes), -1, np.int64)
    for camera in range(len(eyes)):
        facing = _facing(points, normals, eyes[camera])
        if not len(facing):
            continue
        order, start, origin, shape = _cells(points, facing)
        skin, spot = _laid_out(points, normals, order), 0
        for node in range(len(nodes)):
            if seen_from[node] != camera:
                continue
            best = reach * reach
            away = _distance2(skin, spot, nodes, node_normals, node, normal_weight)
            found = spot if away < best else -1
            better = _search(skin, nodes, node_normals, node, normal_weight, start, origin, shape, min(away, best))
            found = better if better >= 0 else found
            if found >= 0:
                nearest[node], spot = order[found], found
    return nearest


@njit(cache=True)
def facing_rows(
    points: np.ndarray, normals: np.ndarray, nodes: np.ndarray, node_normals: np.ndarray, seen_from: np.ndarray,
    eyes: np.ndarray, reach: float, normal_weight: float, uncovered: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Skin point (m,), node (m, 3) and unit direction (m, 3) of every node that has a nearest point.

    The direction is the mean of both normals, and straight to the node where it is farther off than ``uncovered``.
    """
    nearest = nearest_facing(points, normals, nodes, node_normals, seen_from, eyes, reach, normal_weight)
    point, count = np.empty(len(nodes), np.int64), 0
    target, direction, offset = np.empty((len(nodes), 3)), np.empty((len(nodes), 3)), np.empty(3)
    for node in range(len(nodes)):
        p = nearest[node]
        if p < 0:
            continue
        away, squared = 0.0, 0.0
        for i in range(3):
            target[count, i], offset[i] = nodes[node, i], points[p, i] - nodes[node, i]
            direction[count, i] = node_normals[node, i] + normals[p, i]
            away += offset[i] ** 2
            squared += direction[count, i] ** 2
        if away > uncovered * uncovered:
            direction[count], squared = offset, away
        direction[count] /= max(np.sqrt(squared), 1e-9)
        point[count] = p
        count += 1
    return point[:count].copy(), target[:count].copy(), direction[:count].copy()


@njit(cache=True)
def nearest_point(points: np.ndarray, nodes: np.ndarray, reach: float) -> np.ndarray:
    """(n,) int64: the point (p, 3) nearest to each node (n, 3) by place alone, -1 where none is nearer than reach."""
    nearest = np.full(len(nodes), -1, np.int64)
    order, start, origin, shape = _cells(points, np.arange(len(points)))
    skin = _laid_out(points, points, order)
    for node in range(len(nodes)):
        found = _search(skin, nodes, nodes, node, 0.0, start, origin, shape, reach * reach)
        nearest[node] = order[found] if found >= 0 else -1
    return nearest


@njit(cache=True)
def _facing(points: np.ndarray, normals: np.ndarray, eye: np.ndarray) -> np.ndarray:
    facing, count = np.empty(len(points), np.int64), 0
    for p in range(len(points)):
        towards = 0.0
        for axis in range(3):
            towards += (eye[axis] - points[p, axis]) * normals[p, axis]
        if towards > 0.0:
            facing[count] = p
            count += 1
    return facing[:count]


@njit(cache=True)
def _cells(points: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Chosen points, cell after cell; where each cell begins; the lowest corner; how many cells along each axis."""
    origin, top = points[chosen[0]].copy(), points[chosen[0]].copy()
    for p in chosen:
        for axis in range(3):
            origin[axis] = min(origin[axis], points[p, axis])
            top[axis] = max(top[axis], points[p, axis])
    shape = np.empty(3, np.int64)
    for axis in range(3):
        shape[axis] = int((top[axis] - origin[axis]) / CELL_M) + 1
    order, start = sort_by_cell(points[chosen], origin, CELL_M, shape)
    return chosen[order], start, origin, shape


@njit(cache=True)
def _laid_out(points: np.ndarray, normals: np.ndarray, order: np.ndarray) -> np.ndarray:
    """(k, 6) place and normal of the points, those of a cell side by side in memory."""
    skin = np.empty((len(order), 6))
    for k in range(len(order)):
        for axis in range(3):
            skin[k, axis], skin[k, 3 + axis] = points[order[k], axis], normals[order[k], axis]
    return skin


@njit(cache=True)
def _distance2(
    skin: np.ndarray, spot: int, nodes: np.ndarray, node_normals: np.ndarray, node: int, normal_weight: float
) -> float:
    away, turned = 0.0, 0.0
    for axis in range(3):
        away += (skin[spot, axis] - nodes[node, axis]) ** 2
        turned += (skin[spot, 3 + axis] - node_normals[node, axis]) ** 2
    return away + normal_weight * normal_weight * turned


@njit(cache=True)
def _search(
    skin: np.ndarray, nodes: np.ndarray, node_normals: np.ndarray, node: int, normal_weight: float, start: np.ndarray,
    origin: np.ndarray, shape: np.ndarray, best: float,
) -> int:  # fmt: skip
    """Place in ``skin`` of the nearest that is nearer than the root of ``best``, -1 where there is none.

    The node's own cell is looked through first: what is found there narrows the search around it.
    """
    found = -1
    x, y, z = nodes[node, 0] - origin[0], nodes[node, 1] - origin[1], nodes[node, 2] - origin[2]
    i, j, k = int(np.floor(x / CELL_M)), int(np.floor(y / CELL_M)), int(np.floor(z / CELL_M))
    if 0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= k < shape[2]:
        own = (i * shape[1] + j) * shape[2] + k
        for spot in range(start[own], start[own + 1]):
            distance = _distance2(skin, spot, nodes, node_normals, node, normal_weight)
            if distance < best:
                best, found = distance, spot
    radius = np.sqrt(best)
    left, right = max(0, int(np.floor((x - radius) / CELL_M))), min(shape[0] - 1, int(np.floor((x + radius) / CELL_M)))
    low, high = max(0, int(np.floor((y - radius) / CELL_M))), min(shape[1] - 1, int(np.floor((y + radius) / CELL_M)))
    for i in range(left, right + 1):
        for j in range(low, high + 1):
            left_over = best - _gap(x, i) ** 2 - _gap(y, j) ** 2
            if left_over <= 0.0:
                continue
            radius, row = np.sqrt(left_over), (i * shape[1] + j) * shape[2]
            first = max(0, int(np.floor((z - radius) / CELL_M)))
            last = min(shape[2] - 1, int(np.floor((z + radius) / CELL_M)))
            if first > last:
                continue
            for spot in range(start[row + first], start[row + last + 1]):  # cells along z follow one another
                distance = _distance2(skin, spot, nodes, node_normals, node, normal_weight)
                if distance < best:
                    best, found = distance, spot
    return found


@njit(cache=True)
def _gap(place: float, cell: int) -> float:
    """How far a place is from a cell along one axis, 0 within it."""
    return max(cell * CELL_M - place, place - (cell + 1) * CELL_M, 0.0)
