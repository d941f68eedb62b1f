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
from anchorpose.geodesics.shadows import Bends, Rim, cast_shadow, hole_directions
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
    return _detours(surface.arrays, Rim(is_open, hole_directions(surface, is_open)), fields, float(enough_m))


@njit(cache=True, error_model="numpy")
def _detours(mesh: MeshArrays, rim: Rim, fields: np.ndarray, enough: float) -> np.ndarray:
    """(n, k) float32 for fields (k, n). Node by node in the order of distance; only rim nodes and what lies behind them
    need more than a glance."""
    count, is_open = len(mesh.points_m), rim.open
    every = np.full((len(fields), count), np.nan, np.float32)
    corner, root = np.full(count, -1, np.int32), np.full(count, -1, np.int32)
    bends = Bends(np.zeros((count, 2)), corner, root, np.zeros((count, 3)), np.zeros(count))
    for row in range(len(fields)):
        distance, found = fields[row], every[row]
        corner[:], root[:] = -1, -1
        affected = is_open.copy()  # rim nodes, and nodes with a nearer neighbour at a rim or in the shadow
        for number in by_distance(distance):
            node: Any = np.int64(number)
            found[node] = 0.0
            if not affected[node]:
                continue
            bends.place[node, 0], bends.place[node, 1] = distance[node], 0.0
            if not is_open[node]:
                least = _least_before(mesh, distance, found, node)
                if least > enough:
                    found[node], corner[node] = least, -2
                    _mark_neighbours(mesh, node, affected)
                    continue
            found[node] = _detour_of(mesh, rim, distance, found, bends, node)
            if corner[node] != -1 or is_open[node]:
                _mark_neighbours(mesh, node, affected)
    return every.T


@njit(cache=True, error_model="numpy")
def _detour_of(
    mesh: MeshArrays, rim: Rim, distance: np.ndarray, found: np.ndarray, bends: Bends, node: int
) -> np.float32:
    """The detour of one node, from those of the nearer ones; fills in its bends."""
    points, corner, place = mesh.points_m, bends.corner, bends.place
    detour = np.float32(0.0)
    a, b, share = came_from(mesh, distance, node)
    for axis in range(3):  # stays 0 behind a link: a path that comes across the hole does not bend around it
        bends.heading[node, axis] = 0.0
    linked = a >= 0 and not adjoin(mesh.ring, node, a)
    if a >= 0 and not (linked and corner[a] == -1):
        for axis in range(0 if linked else 3):
            start = (1.0 - share) * points[a, axis] + share * points[b, axis]
            bends.heading[node, axis] = points[node, axis] - start
        cast_shadow(mesh, rim, distance, bends, node, (a, b), share, linked)
    if corner[node] >= 0:
        chord = np.sqrt(place[node, 0] ** 2 + place[node, 1] ** 2)
        detour = np.float32(max(distance[node] - chord, 0.0))
    elif corner[node] == -2:
        detour = found[a if share <= 0.5 else b]
    if a == b and a >= 0 and rim.open[a] and rim.open[node] and is_bare(mesh.ring, node, a):
        detour = np.float32(np.inf)
        corner[node] = -2
    return detour


@njit(cache=True, error_model="numpy")
def _least_before(mesh: MeshArrays, distance: np.ndarray, found: np.ndarray, node: int) -> float:
    """The least detour among the nearer neighbours; the node's path passes between two of them."""
    ring, link_start, link_node = mesh.ring, mesh.link_start, mesh.link_node
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
def _mark_neighbours(mesh: MeshArrays, node: int, marked: np.ndarray) -> None:
    ring, link_start, link_node = mesh.ring, mesh.link_start, mesh.link_node
    for k in range(8):
        if ring[node, k] >= 0:
            marked[ring[node, k]] = True
    for k in range(link_start[node], link_start[node + 1]):
        marked[link_node[k]] = True
