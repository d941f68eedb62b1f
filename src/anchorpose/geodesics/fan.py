"""What a marching front needs to know of a node's ring: eight edges and sixteen triangles, eight abreast.

Lanes: the ring places E N W S NE NW SW SE, the four sides of the grid first, because every triangle through which a
node offers a distance has its third corner on such a side: to NE it is the triangle with E or with N, to E the one with
N or with S, whose right angle is at the node. So each lane has a triangle to its left, counter-clockwise, and one to
its right.
"""

from __future__ import annotations

import numpy as np
from numba import njit

LANES = 8
PLACE = np.array([0, 2, 4, 6, 1, 3, 5, 7])  # ring place of each lane
LEFT = np.array([1, 2, 3, 0, 1, 2, 3, 0])  # lane of the side that the triangle to the left stands on
RIGHT = np.array([3, 0, 1, 2, 0, 1, 2, 3])
EDGE2, DOT_LEFT, DOT_RIGHT, FAN = 0, 8, 16, 24  # columns of a fan: squared edges, dot products with the sides; width

AWAY = np.float32(1e6)  # metres; farther than anything, yet its square is a float32
SMALLEST = np.float32(1e-12)  # square metres; nodes that coincide are a micrometre apart, or they would divide by zero


@njit(cache=True, error_model="numpy")
def lay_fan(
    points: np.ndarray, ring: np.ndarray, node: int, near: np.ndarray, fan: np.ndarray, edge: np.ndarray
) -> bool:
    """Fill in the neighbours and edges of one node; whether the surface ends at it.

    points (n, 3) float32; ring (n, 8) int32. near (n, 8) uint32 gets the neighbour in each lane, n where there is none;
    fan (n, 24) float32 the columns above. A triangle exists when all its three edges do: the dot product of any other
    is NaN, which no comparison lets pass. A missing neighbour is ``AWAY``.
    """
    nobody = len(points)
    rim = False
    for lane in range(LANES):
        other = ring[node, PLACE[lane]]
        near[node, lane] = nobody if other < 0 else other
        rim |= other < 0
        for axis in range(3):
            edge[lane, axis] = points[max(other, 0), axis] - points[node, axis]
        length2 = edge[lane, 0] * edge[lane, 0] + edge[lane, 1] * edge[lane, 1] + edge[lane, 2] * edge[lane, 2]
        fan[node, EDGE2 + lane] = AWAY * AWAY if other < 0 else max(length2, SMALLEST)
    for lane in range(LANES):
        other, place = ring[node, PLACE[lane]], PLACE[lane]
        left, right = LEFT[lane], RIGHT[lane]
        dot_left = edge[lane, 0] * edge[left, 0] + edge[lane, 1] * edge[left, 1] + edge[lane, 2] * edge[left, 2]
        dot_right = edge[lane, 0] * edge[right, 0] + edge[lane, 1] * edge[right, 1] + edge[lane, 2] * edge[right, 2]
        whole_left = other >= 0 and ring[other, (place + 3) & 7] == ring[node, PLACE[left]]
        whole_right = other >= 0 and ring[other, (place + 5) & 7] == ring[node, PLACE[right]]
        fan[node, DOT_LEFT + lane] = dot_left if whole_left else np.nan
        fan[node, DOT_RIGHT + lane] = dot_right if whole_right else np.nan
    return rim
