"""Which anchors a node can trust: those whose shortest path does not bend around an occlusion's rim.

Tracking sees the surface with the hole only. Where the path from an anchor grazes the rim of what hides the skin and
turns towards the hidden side, it is a detour: the node lies in the anchor's shadow (paper, Definition 5). The length of
the detour follows from the path itself, as if the hole were filled as flat as the skin around it: laid flat, the path
is a chain of straight pieces, and the path over the whole skin is the chord from its beginning to its end.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numba import njit

from anchorpose.geodesics.paths import adjoin, by_distance, came_from, is_bare, open_nodes
from anchorpose.geodesics.shadows import (
    BEND,
    CHAIN,
    CORNER,
    HEADING,
    NORMAL,
    PLACE,
    POINT,
    SKIN,
    cast_shadow,
    hole_directions,
)
from anchorpose.surface.surface import MeshArrays, Surface

TOLERANCE_M: Final = 0.010
"""A detour that tracking may ignore: half of what the gate allows for the anchors' jitter."""


def trusted_anchors(
    surface: Surface, descriptor: np.ndarray, rim: np.ndarray, tolerance_m: float = TOLERANCE_M
) -> np.ndarray:
    """(n, k) bool: whether a node's distance to an anchor is what it would be without the occlusions.

    descriptor (n, k) metres, from ``anchor_descriptor``: the distances as they are on this surface. rim (n,) bool:
    nodes where something else ends the surface, ``surface.border.border(...) == Border.CUT``; a band of some nodes
    around it does no harm, since only nodes whose own ring of neighbours is open can be bent around. The body's own
    outline is not a rim: it is there in every frame. Links across what hides the skin lead straight on. Anchors missed
    (NaN) or not reached (inf) are not trusted. Where the outline bends a path shortly before a rim does (a hole beside
    the armpit), too few are: the path through the hole would have been bent as well.
    """
    if not tolerance_m >= 0:
        raise ValueError(f"tolerance_m must not be negative, got {tolerance_m}")
    with np.errstate(invalid="ignore"):
        return detour(surface, descriptor, rim, 2.0 * tolerance_m) <= tolerance_m


def detour(surface: Surface, descriptor: np.ndarray, rim: np.ndarray, enough_m: float = np.inf) -> np.ndarray:
    """(n, k) float32 metres: by how much occlusions lengthen each distance, were they filled flat.

    Arguments as in ``trusted_anchors``. NaN where the distance is not finite. A detour only grows along a path, so what
    lies behind nodes of more than ``enough_m`` is given a lower bound of its own, which saves half the time; inf where
    the path squeezes through a strip without triangles beside the occlusion, whose bends are unknown. The direction of
    each path at a rim comes from the field's own triangles, so that any solver's distances will do.
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
    """(n, k) float32 for fields (k, n). Node by node in the order of distance; only rim nodes and what lies behind them
    need more than a glance. is_open (n,) bool, hole (n, 3): see ``shadows.cast_shadow``."""
    count, skin = len(mesh.points_m), _skin(mesh)
    ring, link_start, link_node, link_length = mesh.ring, mesh.link_start, mesh.link_node, mesh.link_length_m
    every = np.full((len(fields), count), np.nan, np.float32)
    bend, chain = np.zeros((count, BEND)), np.empty((count, CHAIN), np.int32)
    for row in range(len(fields)):
        distance, found = fields[row], every[row]
        chain[:] = -1
        affected = is_open.copy()  # rim nodes, and nodes with a nearer neighbour at a rim or in the shadow
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
                cast_shadow(skin, is_open, hole, distance, bend, chain, node, (a, b), share, linked)
            found[node] = _detour_of(distance, found, bend, chain, node, a if share <= 0.5 else b)
            if a == b and a >= 0 and is_open[a] and is_open[node] and is_bare(ring, node, a):
                found[node], chain[node, CORNER] = np.inf, -2
            if chain[node, CORNER] != -1 or is_open[node]:
                _mark_neighbours(ring, link_start, link_node, node, affected)
    return every.T


@njit(cache=True, error_model="numpy")
def _skin(mesh: MeshArrays) -> np.ndarray:
    """(n, 6) float32: points and normals side by side."""
    skin = np.empty((len(mesh.points_m), SKIN), np.float32)
    skin[:, POINT : POINT + 3] = mesh.points_m
    skin[:, NORMAL : NORMAL + 3] = mesh.normals
    return skin


@njit(cache=True, error_model="numpy", inline="always")
def _set_heading(
    skin: np.ndarray, bend: np.ndarray, node: int, edge: tuple[int, int], share: float, known: bool
) -> None:
    """The direction of a path's last piece, which comes from between the ends of an edge.

    It stays 0 behind a link: a path that comes across the hole does not bend around it.
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
    """The detour of one node, whose path is laid out, from that of the nearer node before it."""
    if chain[node, CORNER] >= 0:
        chord = np.sqrt(bend[node, PLACE] ** 2 + bend[node, PLACE + 1] ** 2)
        return np.float32(max(distance[node] - chord, 0.0))
    return found[before] if chain[node, CORNER] == -2 else np.float32(0.0)


@njit(cache=True, error_model="numpy", inline="always")
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


@njit(cache=True, error_model="numpy", inline="always")
def _mark_neighbours(
    ring: np.ndarray, link_start: np.ndarray, link_node: np.ndarray, node: int, marked: np.ndarray
) -> None:
    for k in range(8):
        if ring[node, k] >= 0:
            marked[ring[node, k]] = True
    for k in range(link_start[node], link_start[node + 1]):
        marked[link_node[k]] = True
