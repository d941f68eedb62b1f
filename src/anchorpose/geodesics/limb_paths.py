"""The path from a limb's end to the centre: along it, inside the skin, lies the limb."""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.geodesics.center import CenterField
from anchorpose.geodesics.paths import apart
from anchorpose.surface.surface import MeshArrays, Surface


def limb_path(surface: Surface, field: CenterField, end: int) -> np.ndarray:
    """(k,) int32 nodes from ``end`` to the centre, along which the distance from the centre falls.

    At every node the path goes on to the neighbour, on the grid or across a link, over which the distance is least; at
    the edge of a piece that is cut off it continues at the gap's other side. It has the nodes of the surface only, so
    it is a zigzag of up to 8 % more length than the geodesic. Raises ValueError where the centre is not reached.
    """
    if not (0 <= end < len(surface) and np.isfinite(field.distance_m[end])):
        raise ValueError(f"node {end} of {len(surface)} has no distance from the centre")
    mesh, steps = surface.arrays, list[np.ndarray]()
    node = int(end)
    while node >= 0:
        steps.append(_descend(mesh, field.distance_m, node))
        node = int(field.before[field.piece[steps[-1][-1]]])
    return np.concatenate(steps)


def axis_m(surface: Surface, nodes: np.ndarray, radius_m: float) -> np.ndarray:
    """(k, 3) float64 world: the places of nodes (k,), moved inwards along the skin's normal by a limb's radius."""
    points, normals = surface.points_m[nodes].astype(np.float64), surface.normals[nodes].astype(np.float64)
    inside: np.ndarray = points - radius_m * normals
    return inside


@njit(cache=True, error_model="numpy")
def _descend(mesh: MeshArrays, distance: np.ndarray, start: int) -> np.ndarray:
    """(k,) int32: from a node to the one of its piece that has no nearer neighbour."""
    points, ring, link_start, link_node = mesh.points_m, mesh.ring, mesh.link_start, mesh.link_node
    path = np.empty(len(ring), np.int32)
    count, node = 0, np.int64(start)
    while node >= 0:
        path[count] = node
        count += 1
        best, following = np.inf, np.int64(-1)
        for k in range(8):
            other = np.int64(ring[node, k])
            if other >= 0 and distance[other] < distance[node]:
                reached = distance[other] + apart(points, node, other)
                if reached < best:
                    best, following = reached, other
        for k in range(link_start[node], link_start[node + 1]):
            other = np.int64(link_node[k])
            if distance[other] < distance[node]:
                reached = np.float64(distance[other]) + mesh.link_length_m[k]
                if reached < best:
                    best, following = reached, other
        node = following
    return path[:count].copy()
