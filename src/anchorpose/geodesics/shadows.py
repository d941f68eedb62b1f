"""How a path bends around the rim of an occlusion: the path laid out in a plane, straight piece after straight piece.

Nodes behind a bend lie in the shadow of the rim. In its plane a path begins at the anchor, the origin, along the first
axis; the way over the whole skin, were the hole filled flat, is the chord to the path's end.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from anchorpose.geodesics.paths import apart
from anchorpose.surface.surface import MeshArrays, Surface


class Rim(NamedTuple):
    """open (n,) bool: rim nodes around which the triangles do not close; hole (n, 3) float64: the way out from them."""

    open: np.ndarray
    hole: np.ndarray


class Bends(NamedTuple):
    """How the paths of one field bend around rims.

    place (n, 2): where a shadow node is in the plane that its path is laid out in, the anchor at the origin and the
    path's first piece along the first axis; corner (n,) int32: the rim node around which the path bends last, -1 in the
    light, -2 so deep in the shadow that it is not computed; root (n,) int32: the one around which it bends first, which
    names the plane; heading (n, 3): direction of the path's last piece; side (n,): 1 or -1, to which side a rim node
    bends paths.
    """

    place: np.ndarray
    corner: np.ndarray
    root: np.ndarray
    heading: np.ndarray
    side: np.ndarray


def hole_directions(surface: Surface, is_open: np.ndarray) -> np.ndarray:
    """(n, 3) float64: at an open node, away from the neighbours it has."""
    points, hole = surface.points_m, np.zeros((len(surface), 3))
    nodes = np.flatnonzero(is_open)
    for k in range(8):
        other = surface.ring[nodes, k]
        at, other = nodes[other >= 0], other[other >= 0]
        x, y, z = (points[other].astype(np.float64) - points[at]).T
        length = np.maximum(np.sqrt(x**2 + y**2 + z**2), 1e-9)
        hole[at] -= (points[other] - points[at]) / length[:, None]
    return hole


@njit(cache=True, error_model="numpy")
def cast_shadow(
    mesh: MeshArrays,
    rim: Rim,
    distance: np.ndarray,
    bends: Bends,
    node: int,
    edge: tuple[int, int],
    share: float,
    linked: bool,
) -> None:
    """Where the node lies in the plane of its path, if that bends; its path comes from between the ends of an edge."""
    points, place, corner, root, side = mesh.points_m, bends.place, bends.corner, bends.root, bends.side
    a, b = edge
    if corner[a] == -2 or corner[b] == -2:
        if corner[a if share <= 0.5 else b] == -2:
            corner[node] = -2
            return
        a = a if share <= 0.5 else b
        b, share = a, 0.0
    if rim.open[b] and not rim.open[a]:
        a, b, share = b, a, 1.0 - share
    if rim.open[a] and not linked and (a == b or corner[b] == a or rim.open[b]):
        if rim.open[b] and share > 0.5:
            a = b
        turn = _bend(mesh, rim.hole, bends.heading, a, node)
        if turn != 0.0:
            _around(distance, bends, a, turn, node)
            return
        b, share = a, 0.0
    if corner[a] < 0 and corner[b] < 0:
        return
    if corner[a] < 0:  # a is the one in the shadow
        a, b, share = b, a, 1.0 - share
    last = np.int64(corner[a])
    if corner[b] >= 0 and root[b] == root[a] and distance[corner[b]] > distance[last]:
        last = np.int64(corner[b])
    at_x, at_y = place[a, 0], place[a, 1]
    if share > 0.0 and (corner[b] < 0 or root[b] == root[a]):
        b_x, b_y = place[b, 0], place[b, 1]
        if corner[b] < 0 and b != root[a]:
            b_x, b_y = _third_corner(at_x, at_y, 0.0, 0.0, apart(points, a, b), distance[b], side[root[a]])
        from_a, from_b = apart(points, a, node), apart(points, b, node)
        away = np.sign((b_x - at_x) * (at_y - place[last, 1]) - (b_y - at_y) * (at_x - place[last, 0]))
        at_x, at_y = _third_corner(at_x, at_y, b_x, b_y, from_a, from_b, away)
    _behind(distance, bends, node, last, root[a], at_x, at_y)


@njit(cache=True, error_model="numpy")
def _behind(distance: np.ndarray, bends: Bends, node: int, last: Any, first: int, at_x: float, at_y: float) -> None:
    """The path comes from behind the last corner, or behind the one before it that it still bends around.

    at_x, at_y: where the path leads through, seen from the corners; first: the corner around which it bends first.
    """
    place, corner, root, side = bends.place, bends.corner, bends.root, bends.side
    while last >= 0:
        x, y = at_x - place[last, 0], at_y - place[last, 1]
        in_x, in_y = _arrival(last, place, corner)
        length = np.sqrt(x * x + y * y)
        if (in_x * y - in_y * x) * side[last] > 0.0 and length > 0.0:
            reach = distance[node] - distance[last]
            place[node, 0] = place[last, 0] + reach * x / length
            place[node, 1] = place[last, 1] + reach * y / length
            corner[node], root[node] = last, first
            return
        last = np.int64(corner[last])


@njit(cache=True, error_model="numpy")
def _around(distance: np.ndarray, bends: Bends, at: int, turn: float, node: int) -> None:
    """The path bends at a rim node by ``turn`` and reaches the node from there."""
    place, corner, root = bends.place, bends.corner, bends.root
    x, y = _arrival(at, place, corner)
    reach = distance[node] - distance[at]
    place[node, 0] = place[at, 0] + reach * (x * np.cos(turn) - y * np.sin(turn))
    place[node, 1] = place[at, 1] + reach * (x * np.sin(turn) + y * np.cos(turn))
    corner[node], bends.side[at] = at, np.sign(turn)
    root[node] = root[at] if corner[at] >= 0 else at


@njit(cache=True, error_model="numpy")
def _arrival(at: Any, place: np.ndarray, corner: np.ndarray) -> tuple[float, float]:
    """The direction in which the path comes to a rim node, in the plane."""
    if corner[at] < 0:
        return 1.0, 0.0
    x, y = place[at, 0] - place[corner[at], 0], place[at, 1] - place[corner[at], 1]
    length = max(np.sqrt(x * x + y * y), 1e-9)
    return x / length, y / length


@njit(cache=True, error_model="numpy")
def _third_corner(
    a_x: float, a_y: float, b_x: float, b_y: float, from_a: float, from_b: float, side: float
) -> tuple[float, float]:
    """The point at two distances from a and b; left of the way from a to b for side 1, right of it for -1."""
    x, y = b_x - a_x, b_y - a_y
    length = max(np.sqrt(x * x + y * y), 1e-9)
    along = (from_a * from_a - from_b * from_b + length * length) / (2.0 * length)
    across = side * np.sqrt(max(from_a * from_a - along * along, 0.0))
    return a_x + (x * along - y * across) / length, a_y + (y * along + x * across) / length


@njit(cache=True, error_model="numpy")
def _bend(mesh: MeshArrays, hole: np.ndarray, heading: np.ndarray, at: int, node: int) -> float:
    """The angle between the path's pieces to and from a rim node, seen along the normal; 0 unless towards the hole."""
    points, normals = mesh.points_m, mesh.normals
    cosine, sine, side, up_in, up_out = 0.0, 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        out = np.float64(points[node, axis]) - points[at, axis]
        up_in += heading[at, axis] * normals[at, axis]
        up_out += out * normals[at, axis]
        cosine += heading[at, axis] * out
    cosine -= up_in * up_out
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        out_i, out_j = points[node, i] - points[at, i], points[node, j] - points[at, j]
        sine += normals[at, axis] * (heading[at, i] * out_j - heading[at, j] * out_i)
        side += normals[at, axis] * (heading[at, i] * hole[at, j] - heading[at, j] * hole[at, i])
    if sine * side <= 0.0:
        return 0.0
    return np.arctan2(sine, cosine)
