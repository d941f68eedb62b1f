"""Which anchors a node can trust: those whose shortest path does not bend around an occlusion's rim.

Tracking sees the surface with the hole only. Where the path from an anchor grazes the rim of what hides the skin and
turns towards the hidden side, it is a detour: the node lies in the anchor's shadow (paper, Definition 5). How long a
detour follows from the path itself, if the hole is thought filled as flat as the skin around it: laid flat, the path is
a chain of straight pieces, and the way over the whole skin is the chord from its beginning to its end.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.geodesics.paths import adjoin, apart, by_distance, came_from, is_bare, open_nodes
from anchorpose.surface.surface import Surface

TOLERANCE_M = 0.010
"""A detour that tracking may ignore: half of what the gate allows for the anchors' jitter."""


def trusted_anchors(
    surface: Surface, descriptor: np.ndarray, rim: np.ndarray, tolerance_m: float = TOLERANCE_M
) -> np.ndarray:
    """(n, k) bool: whether a node's distance to an anchor is what it would be without the occlusions.

    descriptor (n, k) metres, from ``anchor_descriptor``: the distances as they are on this surface. rim (n,) bool:
    nodes where something else ends the surface, ``surface.border.border(...) == Border.CUT``; a band of some nodes
    around it does no harm, since only nodes whose own ring of neighbours is open can be bent around. The body's own
    outline is no rim: it is there in every frame. Links across what hides the skin lead straight on. Anchors missed
    (NaN) or not reached (inf) are not trusted. Where the outline bends a path shortly before a rim does (a hole beside
    the armpit), too few are: the way through the hole would have been bent as well.
    """
    if not tolerance_m >= 0:
        raise ValueError(f"tolerance_m must not be negative, got {tolerance_m}")
    with np.errstate(invalid="ignore"):
        return detour(surface, descriptor, rim, 2.0 * tolerance_m) <= tolerance_m


def detour(surface: Surface, descriptor: np.ndarray, rim: np.ndarray, enough_m: float = np.inf) -> np.ndarray:
    """(n, k) float32 metres: by how much occlusions lengthen each distance, were they filled flat.

    Arguments as in ``trusted_anchors``. NaN where the distance is not finite. A detour only grows along a path, so what
    lies behind nodes of more than ``enough_m`` is given a lower bound of its own, which saves half the time; inf where
    the path squeezes through a strip without triangles beside the occlusion, whose bends nobody knows. The direction of
    each path at a rim comes from the field's own triangles, so that any solver's distances will do.
    """
    if descriptor.ndim != 2 or len(descriptor) != len(surface) or rim.shape != (len(surface),) or rim.dtype != bool:
        raise ValueError(
            f"descriptor {descriptor.shape} and rim {rim.shape} {rim.dtype} do not fit {len(surface)} nodes"
        )
    if not np.isfinite(surface.points_m).all() or not np.isfinite(surface.normals).all():
        raise ValueError("the surface has nodes whose position or normal is not finite")
    return _detours(
        np.ascontiguousarray(surface.points_m, dtype=np.float32),
        np.ascontiguousarray(surface.normals, dtype=np.float32),
        surface.ring,
        surface.link_start,
        surface.link_node,
        surface.link_length_m,
        np.ascontiguousarray(descriptor.T, dtype=np.float32),
        open_nodes(surface.ring, rim),
        np.float64(enough_m),
    )


@njit(cache=True, error_model="numpy")
def _detours(
    points: np.ndarray,
    normals: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    link_length: np.ndarray,
    fields: np.ndarray,
    rim: np.ndarray,
    enough: float,
) -> np.ndarray:
    """(n, k). Node by node in the order of distance; only rim nodes and what lies behind them need more than a glance.

    place (n, 2): where a shadow node is in the plane that its path is laid out in, the anchor at the origin and the
    path's first piece along the first axis; corner (n,): the rim node around which the path bends last, -1 in the
    light, -2 so deep in the shadow that nobody asks; root (n,): the one around which it bends first, which names the
    plane.
    """
    count = len(points)
    every = np.full((len(fields), count), np.nan, np.float32)
    hole = _hole_directions(points, ring, rim)
    place, heading, side = np.zeros((count, 2)), np.zeros((count, 3)), np.zeros(count)
    corner, root = np.full(count, -1, np.int32), np.full(count, -1, np.int32)
    at_stake = np.zeros(count, np.bool_)  # rim nodes, and nodes with a nearer neighbour at a rim or in the shadow
    for row in range(len(fields)):
        distance, found = fields[row], every[row]
        corner[:], root[:], at_stake[:] = -1, -1, rim
        for node in by_distance(distance):
            found[node] = 0.0
            if not at_stake[node]:
                continue
            place[node, 0], place[node, 1] = distance[node], 0.0
            if not rim[node]:
                least = _least_before(ring, link_start, link_node, distance, found, node)
                if least > enough:
                    found[node], corner[node] = least, -2
                    _hand_on(ring, link_start, link_node, node, at_stake)
                    continue
            a, b, share = came_from(points, ring, link_start, link_node, link_length, distance, node)
            heading[node] = 0.0  # and stays so behind a link: who comes across the hole does not bend around it
            linked = a >= 0 and not adjoin(ring, node, a)
            if a >= 0 and not (linked and corner[a] == -1):
                for axis in range(0 if linked else 3):
                    start = (1.0 - share) * points[a, axis] + share * points[b, axis]
                    heading[node, axis] = points[node, axis] - start
                _cast_shadow(
                    points, normals, hole, rim, distance, a, b, share, linked, node, place, corner, root, side, heading
                )
            if corner[node] >= 0:
                chord = np.sqrt(place[node, 0] ** 2 + place[node, 1] ** 2)
                found[node] = max(distance[node] - chord, 0.0)
            elif corner[node] == -2:
                found[node] = found[a if share <= 0.5 else b]
            if a == b and a >= 0 and rim[a] and rim[node] and is_bare(ring, node, a):
                found[node], corner[node] = np.inf, -2
            if corner[node] != -1 or rim[node]:
                _hand_on(ring, link_start, link_node, node, at_stake)
    return every.T


@njit(cache=True, error_model="numpy")
def _cast_shadow(
    points: np.ndarray,
    normals: np.ndarray,
    hole: np.ndarray,
    rim: np.ndarray,
    distance: np.ndarray,
    a: int,
    b: int,
    share: float,
    linked: bool,
    node: int,
    place: np.ndarray,
    corner: np.ndarray,
    root: np.ndarray,
    side: np.ndarray,
    heading: np.ndarray,
) -> None:
    """Where the node lies in the plane of its path, if that bends; its path comes from between a and b."""
    if corner[a] == -2 or corner[b] == -2:
        if corner[a if share <= 0.5 else b] == -2:
            corner[node] = -2
            return
        a = a if share <= 0.5 else b
        b, share = a, 0.0
    if rim[b] and not rim[a]:
        a, b, share = b, a, 1.0 - share
    if rim[a] and not linked and (a == b or corner[b] == a or rim[b]):
        if rim[b] and share > 0.5:
            a = b
        turn = _bend(normals, hole, heading, points, a, node)
        if turn != 0.0:
            _around(distance, a, turn, node, place, corner, root, side)
            return
        b, share = a, 0.0
    if corner[a] < 0 and corner[b] < 0:
        return
    if corner[a] < 0:  # a is the one in the shadow
        a, b, share = b, a, 1.0 - share
    last = corner[a]
    if corner[b] >= 0 and root[b] == root[a] and distance[corner[b]] > distance[last]:
        last = corner[b]
    at_x, at_y = place[a, 0], place[a, 1]
    if share > 0.0 and (corner[b] < 0 or root[b] == root[a]):
        b_x, b_y = place[b, 0], place[b, 1]
        if corner[b] < 0 and b != root[a]:
            b_x, b_y = _third_corner(at_x, at_y, 0.0, 0.0, apart(points, a, b), distance[b], side[root[a]])
        from_a, from_b = apart(points, a, node), apart(points, b, node)
        away = np.sign((b_x - at_x) * (at_y - place[last, 1]) - (b_y - at_y) * (at_x - place[last, 0]))
        at_x, at_y = _third_corner(at_x, at_y, b_x, b_y, from_a, from_b, away)
    while last >= 0:
        x, y = at_x - place[last, 0], at_y - place[last, 1]
        in_x, in_y = _arrival(last, place, corner)
        length = np.sqrt(x * x + y * y)
        if (in_x * y - in_y * x) * side[last] > 0.0 and length > 0.0:
            reach = distance[node] - distance[last]
            place[node, 0] = place[last, 0] + reach * x / length
            place[node, 1] = place[last, 1] + reach * y / length
            corner[node], root[node] = last, root[a]
            return
        last = corner[last]


@njit(cache=True, error_model="numpy")
def _around(
    distance: np.ndarray,
    at: int,
    turn: float,
    node: int,
    place: np.ndarray,
    corner: np.ndarray,
    root: np.ndarray,
    side: np.ndarray,
) -> None:
    """The path bends at a rim node by ``turn`` and reaches the node from there."""
    x, y = _arrival(at, place, corner)
    reach = distance[node] - distance[at]
    place[node, 0] = place[at, 0] + reach * (x * np.cos(turn) - y * np.sin(turn))
    place[node, 1] = place[at, 1] + reach * (x * np.sin(turn) + y * np.cos(turn))
    corner[node], side[at] = at, np.sign(turn)
    root[node] = root[at] if corner[at] >= 0 else at


@njit(cache=True, error_model="numpy")
def _arrival(at: int, place: np.ndarray, corner: np.ndarray) -> tuple[float, float]:
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
def _bend(normals: np.ndarray, hole: np.ndarray, heading: np.ndarray, points: np.ndarray, at: int, node: int) -> float:
    """The angle between the path's pieces to and from a rim node, seen along the normal; 0 unless towards the hole."""
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


@njit(cache=True, error_model="numpy")
def _least_before(
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    distance: np.ndarray,
    found: np.ndarray,
    node: int,
) -> float:
    """The least detour among the nearer neighbours; the node's path passes between two of them."""
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


@njit(cache=True, error_model="numpy")
def _hand_on(ring: np.ndarray, link_start: np.ndarray, link_node: np.ndarray, node: int, at_stake: np.ndarray) -> None:
    for k in range(8):
        if ring[node, k] >= 0:
            at_stake[ring[node, k]] = True
    for k in range(link_start[node], link_start[node + 1]):
        at_stake[link_node[k]] = True


@njit(cache=True, error_model="numpy")
def _hole_directions(points: np.ndarray, ring: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """(n, 3): at a rim node, away from the neighbours it has."""
    hole = np.zeros((len(points), 3))
    for node in range(len(points)):
        for k in range(8):
            if rim[node] and ring[node, k] >= 0:
                length = apart(points, ring[node, k], node)
                for axis in range(3):
                    hole[node, axis] -= (points[ring[node, k], axis] - points[node, axis]) / max(length, 1e-9)
    return hole
