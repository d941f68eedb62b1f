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
WIDE = 4  # columns that are copied as one number
PLACE = np.array([0, 2, 4, 6, 1, 3, 5, 7])  # ring place of each lane
LEFT = np.array([1, 2, 3, 0, 1, 2, 3, 0])  # lane of the side that the triangle to the left stands on
RIGHT = np.array([3, 0, 1, 2, 0, 1, 2, 3])
# columns of a fan: edges; how high the neighbour stands over each side and how far along it, in sides; the squared
# sides themselves; width
ARM, TALL_LEFT, LEAN_LEFT, TALL_RIGHT, LEAN_RIGHT, SIDE2_LEFT, SIDE2_RIGHT, FAN = 0, 8, 16, 24, 32, 40, 48, 56

# columns behind it while it is laid: for each axis the sides to the left of all lanes, from the seventh on those to the
# right, from the eleventh on the edges themselves; then 0 for each triangle, NaN where it lacks an edge; width,
# no power of two, of which all rows would share a few places of the nearest cache
SPOKES, TO_RIGHT, TO_SELF, SPOKE_COUNT, GAP_LEFT, GAP_RIGHT, DESK = 56, 6, 10, 18, 110, 118, 144

AWAY = np.float32(1e6)  # metres; farther than anything, yet its square is a float32
SMALLEST = np.float32(1e-12)  # square metres; nodes that coincide are a micrometre apart, or they would divide by zero


@njit(cache=True)
def spread_spokes(
    points: np.ndarray, ring: np.ndarray, node: int, near: np.ndarray, desk: np.ndarray, row: int
) -> bool:
    """Fill in the neighbours of one node, and its edges on a row of the desk; whether the surface ends at it.

    points (n, 3) float32; ring (n, 8) int32. near (n, 8) uint32 gets the neighbour in each lane, n where there is none,
    which is ``AWAY``; desk (m, 144) float32 the columns above. A triangle exists when all its three edges do.
    """
    nobody = len(points)
    rim = False
    for lane in range(LANES):
        place = PLACE[lane]
        other = ring[node, place]
        missing = other < 0
        near[node, lane] = nobody if missing else other
        rim |= missing
        other = max(other, 0)
        for axis in range(3):
            away = AWAY if axis == 0 else np.float32(0.0)
            edge = away if missing else points[other, axis] - points[node, axis]
            desk[row, SPOKES + axis * SPOKE_COUNT + TO_SELF + lane] = edge
        left, right = ring[node, PLACE[LEFT[lane]]], ring[node, PLACE[RIGHT[lane]]]
        whole_left = ring[other, (place + 3) & 7] == left and not missing
        whole_right = ring[other, (place + 5) & 7] == right and not missing
        desk[row, GAP_LEFT + lane] = 0.0 if whole_left else np.nan
        desk[row, GAP_RIGHT + lane] = 0.0 if whole_right else np.nan
    for axis in range(3):
        at = SPOKES + axis * SPOKE_COUNT
        e, n, w, s = desk[row, at + 10], desk[row, at + 11], desk[row, at + 12], desk[row, at + 13]
        desk[row, at], desk[row, at + 1], desk[row, at + 2], desk[row, at + 3] = n, w, s, e
        desk[row, at + 4], desk[row, at + 5], desk[row, at + 6], desk[row, at + 7] = n, w, s, e
        desk[row, at + 8], desk[row, at + 9] = n, w
    return rim


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz"})
def lay_fans(desk: np.ndarray, count: int) -> None:
    """From the spokes on the first rows of the desk to fans in its first columns; desk flat, for vector instructions.

    Whatever does not change with the distances is worked out here, once for all fields. The lean of a triangle that
    does not exist is NaN, which no comparison lets pass.
    """
    zero = np.float32(0.0)
    for k in range(count):
        for lane in range(LANES):
            at = k * DESK + lane
            x, y, z = at + SPOKES, at + SPOKES + SPOKE_COUNT, at + SPOKES + 2 * SPOKE_COUNT
            own_x, own_y, own_z = desk[x + TO_SELF], desk[y + TO_SELF], desk[z + TO_SELF]
            left_x, left_y, left_z = desk[x], desk[y], desk[z]
            right_x, right_y, right_z = desk[x + TO_RIGHT], desk[y + TO_RIGHT], desk[z + TO_RIGHT]
            arm2 = max(own_x * own_x + own_y * own_y + own_z * own_z, SMALLEST)
            left2 = max(left_x * left_x + left_y * left_y + left_z * left_z, SMALLEST)
            right2 = max(right_x * right_x + right_y * right_y + right_z * right_z, SMALLEST)
            dot_left = own_x * left_x + own_y * left_y + own_z * left_z
            dot_right = own_x * right_x + own_y * right_y + own_z * right_z
            desk[at + ARM] = np.sqrt(arm2)
            desk[at + TALL_LEFT] = np.sqrt(max(arm2 * left2 - dot_left * dot_left, zero)) / left2
            desk[at + TALL_RIGHT] = np.sqrt(max(arm2 * right2 - dot_right * dot_right, zero)) / right2
            desk[at + LEAN_LEFT] = dot_left / left2 + desk[at + GAP_LEFT]
            desk[at + LEAN_RIGHT] = dot_right / right2 + desk[at + GAP_RIGHT]
            desk[at + SIDE2_LEFT], desk[at + SIDE2_RIGHT] = left2, right2
