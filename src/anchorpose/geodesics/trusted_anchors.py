"""Decide which of a node's distances to the anchors can be trusted. Behind a hole in the surface they are too long,
since the path must go around the hole.

The path from an anchor to a node is a detour if it touches the rim of a hole in the surface and bends towards the hole.
All nodes behind the bend lie in the anchor's shadow (paper, Definition 5). To find the length of the detour, the path
is laid flat into a plane, with the anchor at the origin and the path's first piece along the first axis; there the path
is a chain of straight pieces. Over the complete skin, the path would be the chord: the straight line from the anchor to
the node. The detour is the path's length minus the length of this chord. The computation assumes that the hole is as
flat as the skin around it.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numba import njit

from anchorpose.geodesics.paths import adjoin, apart, by_distance, came_from, is_bare, open_nodes
from anchorpose.surface.surface import MeshArrays, Surface

POINT, NORMAL, SKIN = 0, 3, 6  # in ``skin``: first column of the point and of the normal, number of columns
PLACE, HEADING, SIDE, BEND = 0, 2, 5, 6  # first columns of ``bend`` (see below), and its number of columns
CORNER, ROOT, CHAIN = 0, 1, 2  # columns of ``chain`` (see below), and their number
"""Columns of the arrays in which the kernels keep the values of the n nodes.

Functions that are called for every node take plain arrays and are inlined. When they took a named tuple of arrays,
numba counted the references to the arrays at every call, which took four fifths of the computing time.

- skin (n, 6) float32: point and normal.
- bend (n, 6) float64: how the paths of one field bend around rims. PLACE: place of a node in a shadow, in the plane
  into which the node's path is laid flat; HEADING: direction of the last piece of the path; SIDE: 1 or -1, the side to
  which a path bends.
- chain (n, 2) int32. CORNER: the rim node at which the path bends last, -1 outside shadows, -2 if the node is so deep
  in a shadow that the corner is not computed; ROOT: the rim node at which the path bends first, which identifies the
  plane.
"""


def hole_directions(surface: Surface, is_open: np.ndarray) -> np.ndarray:
    """Return (n, 3) float64: at an open node (a rim node with gaps in its ring), a vector that points away from the
    node's neighbours, that is, into the hole; 0 at all other nodes.
    """
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
    skin: np.ndarray,
    is_open: np.ndarray,
    hole: np.ndarray,
    distance: np.ndarray,
    bend: np.ndarray,
    chain: np.ndarray,
    node: int,
    edge: tuple[int, int, float, bool],
) -> None:
    """If the path from the anchor to a node bends around a hole, write to ``bend`` and ``chain`` where the node lies in
    the plane into which this path is laid flat, and at which rim nodes the path bends.

    edge: the last edge that the path crosses before the node: its ends a and b, where the path crosses it as a share of
    the way from a to b, and whether the edge is a link. is_open (n,) bool: rim nodes whose triangles do not close
    around them; hole (n, 3) float64: from ``hole_directions``.
    """
    a, b, share, linked = edge
    if chain[a, CORNER] == -2 or chain[b, CORNER] == -2:
        if chain[a if share <= 0.5 else b, CORNER] == -2:
            chain[node, CORNER] = -2
            return
        a = a if share <= 0.5 else b
        b, share = a, 0.0
    if is_open[b] and not is_open[a]:
        a, b, share = b, a, 1.0 - share
    if is_open[a] and not linked and (a == b or chain[b, CORNER] == a or is_open[b]):
        if is_open[b] and share > 0.5:
            a = b
        turn = _turn(skin, hole, bend, a, node)
        if turn != 0.0:
            _around(distance, bend, chain, a, turn, node)
            return
        b, share = a, 0.0
    if chain[a, CORNER] < 0 and chain[b, CORNER] < 0:
        return
    if chain[a, CORNER] < 0:  # exchange a and b, so that a lies in the shadow
        a, b, share = b, a, 1.0 - share
    last = np.int64(chain[a, CORNER])
    if chain[b, CORNER] >= 0 and chain[b, ROOT] == chain[a, ROOT] and distance[chain[b, CORNER]] > distance[last]:
        last = np.int64(chain[b, CORNER])
    at_x, at_y = bend[a, PLACE], bend[a, PLACE + 1]
    if share > 0.0 and (chain[b, CORNER] < 0 or chain[b, ROOT] == chain[a, ROOT]):
        b_x, b_y = bend[b, PLACE], bend[b, PLACE + 1]
        if chain[b, CORNER] < 0 and b != chain[a, ROOT]:
            b_x, b_y = _third_corner(at_x, at_y, 0.0, 0.0, apart(skin, a, b), distance[b], bend[chain[a, ROOT], SIDE])
        from_a, from_b = apart(skin, a, node), apart(skin, b, node)
        away = np.sign((b_x - at_x) * (at_y - bend[last, PLACE + 1]) - (b_y - at_y) * (at_x - bend[last, PLACE]))
        at_x, at_y = _third_corner(at_x, at_y, b_x, b_y, from_a, from_b, away)
    _behind(distance, bend, chain, node, last, chain[a, ROOT], at_x, at_y)


@njit(cache=True, error_model="numpy")
def _behind(
    distance: np.ndarray,
    bend: np.ndarray,
    chain: np.ndarray,
    node: int,
    last: Any,
    first: int,
    at_x: float,
    at_y: float,
) -> None:
    """Unfold the shortest path to a node into a plane. Write the node's place in this plane to ``bend``. Write to
    ``chain`` the last and the first corner of the path, that is, the rim nodes at which it bends last and first.

    at_x, at_y: the place in this plane towards which the path runs from its last corner; last: the last rim node that
    may be a corner of the path (if the path does not bend there, the corners before it are tried); first: the corner at
    which the path bends first.
    """
    while last >= 0:
        x, y = at_x - bend[last, PLACE], at_y - bend[last, PLACE + 1]
        in_x, in_y = _arrival(last, bend, chain)
        length = np.sqrt(x * x + y * y)
        if (in_x * y - in_y * x) * bend[last, SIDE] > 0.0 and length > 0.0:
            reach = distance[node] - distance[last]
            bend[node, PLACE] = bend[last, PLACE] + reach * x / length
            bend[node, PLACE + 1] = bend[last, PLACE + 1] + reach * y / length
            chain[node, CORNER], chain[node, ROOT] = last, first
            return
        last = np.int64(chain[last, CORNER])


@njit(cache=True, error_model="numpy")
def _around(distance: np.ndarray, bend: np.ndarray, chain: np.ndarray, at: int, turn: float, node: int) -> None:
    """Write to ``bend`` and ``chain`` the place and the corners of a node whose path bends last at the rim node ``at``,
    by the angle ``turn`` (radians).
    """
    x, y = _arrival(at, bend, chain)
    reach = distance[node] - distance[at]
    bend[node, PLACE] = bend[at, PLACE] + reach * (x * np.cos(turn) - y * np.sin(turn))
    bend[node, PLACE + 1] = bend[at, PLACE + 1] + reach * (x * np.sin(turn) + y * np.cos(turn))
    chain[node, CORNER], bend[at, SIDE] = at, np.sign(turn)
    chain[node, ROOT] = chain[at, ROOT] if chain[at, CORNER] >= 0 else at


@njit(cache=True, error_model="numpy")
def _arrival(at: Any, bend: np.ndarray, chain: np.ndarray) -> tuple[float, float]:
    """Return the direction (x, y) in which the path reaches the rim node ``at``, in the plane into which the path is
    laid flat.
    """
    before = chain[at, CORNER]
    if before < 0:
        return 1.0, 0.0
    x, y = bend[at, PLACE] - bend[before, PLACE], bend[at, PLACE + 1] - bend[before, PLACE + 1]
    length = max(np.sqrt(x * x + y * y), 1e-9)
    return x / length, y / length


@njit(cache=True, error_model="numpy")
def _third_corner(
    a_x: float, a_y: float, b_x: float, b_y: float, from_a: float, from_b: float, side: float
) -> tuple[float, float]:
    """Return the point at given distances from a and b: left of the line from a to b for side 1, right for side -1."""
    x, y = b_x - a_x, b_y - a_y
    length = max(np.sqrt(x * x + y * y), 1e-9)
    along = (from_a * from_a - from_b * from_b + length * length) / (2.0 * length)
    across = side * np.sqrt(max(from_a * from_a - along * along, 0.0))
    return a_x + (x * along - y * across) / length, a_y + (y * along + x * across) / length


@njit(cache=True, error_model="numpy")
def _turn(skin: np.ndarray, hole: np.ndarray, bend: np.ndarray, at: int, node: int) -> float:
    """Return the angle (radians) by which the path to ``node`` turns at the rim node ``at``, seen along the normal of
    ``at``; 0 if the path does not bend towards the hole.
    """
    cosine, sine, side, up_in, up_out = 0.0, 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        out = np.float64(skin[node, POINT + axis]) - skin[at, POINT + axis]
        up_in += bend[at, HEADING + axis] * skin[at, NORMAL + axis]
        up_out += out * skin[at, NORMAL + axis]
        cosine += bend[at, HEADING + axis] * out
    cosine -= up_in * up_out
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        in_i, in_j = bend[at, HEADING + i], bend[at, HEADING + j]
        out_i = skin[node, POINT + i] - skin[at, POINT + i]
        out_j = skin[node, POINT + j] - skin[at, POINT + j]
        sine += skin[at, NORMAL + axis] * (in_i * out_j - in_j * out_i)
        side += skin[at, NORMAL + axis] * (in_i * hole[at, j] - in_j * hole[at, i])
    if sine * side <= 0.0:
        return 0.0
    return np.arctan2(sine, cosine)


TOLERANCE_M: Final = 0.010
"""Maximum detour in metres that tracking may ignore: half of the anchor jitter that the gate for matches allows
(``track_tree.hypotheses.GateConfig.anchor_bound_m``).
"""


def trusted_anchors(
    surface: Surface, descriptor: np.ndarray, rim: np.ndarray, tolerance_m: float = TOLERANCE_M
) -> np.ndarray:
    """Return (n, k) bool: whether a node's distance to an anchor is as long as it would be without occlusions.

    descriptor (n, k) metres, from ``anchor_descriptor``: the distance of each node to each anchor along this surface.
    rim (n,) bool: nodes at which the surface ends because something hides the rest of it (``Border.CUT``). A few nodes
    beside the border may be True, too: only nodes with an open ring of neighbours bend paths. The body's own outline is
    not a rim: it bends paths in the same way in every frame, so these paths are not too long. Links across hidden skin
    do not bend paths. Missed (NaN) or unreached (inf) anchors are not trusted. If the outline bends a path shortly
    before a rim does (at a hole beside the armpit), the computed detour is too long: the path over the complete skin
    would bend at the outline, too. In this case, fewer anchors are trusted than could be.
    """
    if not tolerance_m >= 0:
        raise ValueError(f"tolerance_m must not be negative, got {tolerance_m}")
    with np.errstate(invalid="ignore"):
        return detour(surface, descriptor, rim, 2.0 * tolerance_m) <= tolerance_m


def detour(surface: Surface, descriptor: np.ndarray, rim: np.ndarray, enough_m: float = np.inf) -> np.ndarray:
    """Return (n, k) float32 metres: how much longer each distance from a node to an anchor is than it would be if the
    occluded holes of the surface were filled by flat skin.

    The arguments are those of ``trusted_anchors``. The detour is NaN if the distance is not finite. Along a path, the
    detour of a node is never smaller than the detour of the node before. So nodes behind a detour of more than
    ``enough_m`` get a lower bound of their detour, which halves the computing time of this function. The detour is inf
    if the path runs along an edge between two open rim nodes that belongs to no triangle, since bends are unknown
    there. The direction of each path at a rim is computed from the distances alone, so they may come from any solver.
    """
    if descriptor.ndim != 2 or len(descriptor) != len(surface) or rim.shape != (len(surface),) or rim.dtype != bool:
        raise ValueError(
            f"descriptor {descriptor.shape} and rim {rim.shape} {rim.dtype} do not fit {len(surface)} nodes"
        )
    if not np.isfinite(surface.points_m).all() or not np.isfinite(surface.normals).all():
        raise ValueError("the surface has nodes whose position or normal is not finite")
    fields = np.ascontiguousarray(descriptor.T, dtype=np.float32)
    is_open = open_nodes(surface.ring, rim)
    return _detours(surface.arrays, is_open, hole_directions(surface, is_open), fields, float(enough_m))


@njit(cache=True, error_model="numpy")
def _detours(mesh: MeshArrays, is_open: np.ndarray, hole: np.ndarray, fields: np.ndarray, enough: float) -> np.ndarray:
    """Return the detours (n, k) float32 of all paths to k anchors, from the distances (k, n) of the nodes to these
    anchors, computed node by node in the order of distance. is_open (n,) bool, hole (n, 3): as in ``cast_shadow``.
    """
    count, skin = len(mesh.points_m), _skin(mesh)
    ring, link_start, link_node, link_length = mesh.ring, mesh.link_start, mesh.link_node, mesh.link_length_m
    every = np.full((len(fields), count), np.nan, np.float32)
    bend, chain = np.zeros((count, BEND)), np.empty((count, CHAIN), np.int32)
    for row in range(len(fields)):
        distance, found = fields[row], every[row]
        chain[:] = -1
        # nodes whose path may bend: open rim nodes, and all nodes with a neighbour that is nearer to the anchor and is
        # an open rim node or lies in a shadow
        affected = is_open.copy()
        for number in by_distance(distance):
            node: Any = np.int64(number)
            found[node] = 0.0
            if not affected[node]:
                continue
            bend[node, PLACE], bend[node, PLACE + 1] = distance[node], 0.0
            if not is_open[node]:
                least = _least_before(ring, link_start, link_node, distance, found, node)
                if least > enough:
                    found[node], chain[node, CORNER] = least, -2
                    _mark_neighbours(ring, link_start, link_node, node, affected)
                    continue
            a, b, share = came_from(skin, ring, link_start, link_node, link_length, distance, node)
            linked = a >= 0 and not adjoin(ring, node, a)
            comes = a >= 0 and not (linked and chain[a, CORNER] == -1)
            _set_heading(skin, bend, node, (a, b), share, comes and not linked)
            if comes:
                cast_shadow(skin, is_open, hole, distance, bend, chain, node, (a, b, share, linked))
            found[node] = _detour_of(distance, found, bend, chain, node, a if share <= 0.5 else b)
            if a == b and a >= 0 and is_open[a] and is_open[node] and is_bare(ring, node, a):
                found[node], chain[node, CORNER] = np.inf, -2
            if chain[node, CORNER] != -1 or is_open[node]:
                _mark_neighbours(ring, link_start, link_node, node, affected)
    return every.T


@njit(cache=True, error_model="numpy")
def _skin(mesh: MeshArrays) -> np.ndarray:
    """Return the points and normals of the mesh side by side in a single array (n, 6) float32, with the columns
    ``POINT`` and ``NORMAL``.
    """
    skin = np.empty((len(mesh.points_m), SKIN), np.float32)
    for node in range(len(skin)):
        for axis in range(3):  # a loop, since numba takes four seconds longer to compile a slice
            skin[node, POINT + axis] = mesh.points_m[node, axis]
            skin[node, NORMAL + axis] = mesh.normals[node, axis]
    return skin


@njit(cache=True, error_model="numpy", inline="always")
def _set_heading(
    skin: np.ndarray, bend: np.ndarray, node: int, edge: tuple[int, int], share: float, known: bool
) -> None:
    """Write to ``bend`` the direction of the last piece of the path to a node; this piece begins on the edge between
    two other nodes.

    After a link (an edge that crosses a gap or a hole), the direction stays 0, since a path across a hole does not bend
    around the hole.
    """
    a, b = edge
    for axis in range(3):
        bend[node, HEADING + axis] = 0.0
        if known:
            start = (1.0 - share) * skin[a, POINT + axis] + share * skin[b, POINT + axis]
            bend[node, HEADING + axis] = skin[node, POINT + axis] - start


@njit(cache=True, error_model="numpy", inline="always")
def _detour_of(
    distance: np.ndarray, found: np.ndarray, bend: np.ndarray, chain: np.ndarray, node: int, before: int
) -> np.float32:
    """Return a node's detour: the length of the path from the anchor to the node, minus the length of the chord (the
    straight line between the ends of this path when it is laid flat). If the node is so deep in a shadow that the
    corners of its path are not computed, return the detour of the preceding node of the path; outside shadows, return
    0.
    """
    if chain[node, CORNER] >= 0:
        chord = np.sqrt(bend[node, PLACE] ** 2 + bend[node, PLACE + 1] ** 2)
        return np.float32(max(distance[node] - chord, 0.0))
    return found[before] if chain[node, CORNER] == -2 else np.float32(0.0)


@njit(cache=True, error_model="numpy", inline="always")
def _least_before(
    ring: np.ndarray, link_start: np.ndarray, link_node: np.ndarray, distance: np.ndarray, found: np.ndarray, node: int
) -> float:
    """Return the smallest detour of those neighbours of the node that are nearer to the anchor. The shortest path to
    the node passes between two of these neighbours, so the node's own detour cannot be smaller.
    """
    least = np.inf
    for k in range(8):
        other = ring[node, k]
        if other >= 0 and distance[other] < distance[node]:
            least = min(least, np.float64(found[other]))
    for k in range(link_start[node], link_start[node + 1]):
        other = link_node[k]
        if distance[other] < distance[node]:
            least = min(least, np.float64(found[other]))
    return least


@njit(cache=True, error_model="numpy", inline="always")
def _mark_neighbours(
    ring: np.ndarray, link_start: np.ndarray, link_node: np.ndarray, node: int, marked: np.ndarray
) -> None:
    for k in range(8):
        if ring[node, k] >= 0:
            marked[ring[node, k]] = True
    for k in range(link_start[node], link_start[node + 1]):
        marked[link_node[k]] = True
