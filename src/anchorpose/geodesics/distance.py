"""Compute geodesic distances (lengths of the shortest paths along a surface) by fast marching with unfolding (paper, gd
of Section IV-A).

The mean error of a computed distance is 3 to 9 mm. A front (the edge of the region whose distances are known) starts at
the source and reaches the nodes in the order of distance. A node gets its distance from a triangle that it forms with
two neighbours whose distances are known. The triangle is laid into a plane, in which the source lies at the known
distances from both neighbours; this is exact where the surface is flat. Across a link (an edge outside the camera's
pixel grid, for example between two cameras' nodes), the link's length is added.

The usual fast marching algorithm takes one node after the other from a heap, so it cannot run in parallel. Here the
front advances in rounds. A node with a new distance waits for a later round. In a round, all waiting nodes below the
round's distance threshold are active: each computes candidate distances of its ring, that is, its eight neighbours
(``fans``). The eight are computed in parallel, in the processor's vector registers. A node whose distance is reduced
waits again, even if it was active before. The active nodes form a band along the front. This band is narrower than an
edge, so fewer than 2 nodes in 100 are active twice. Within a round no node uses another node's new distance, so the
result does not depend on the order of the nodes. Source of the rounds: Kim 2001 (doi:10.1137/S1064827500367130).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit

from anchorpose.geodesics.fans import (
    AWAY,
    CANDIDATE,
    CANDIDATE_BEND,
    LANES,
    OWN,
    OWN_BEND,
    UPDATED,
    Fans,
    Rows,
    empty_fans,
    empty_rows,
    fill_fans,
    find_candidates,
    gather,
)
from anchorpose.surface.surface import MeshArrays, Surface

_BITS: Final = (np.arange(256)[:, None] >> np.arange(LANES)) & 1
# (256, 8), one row per value of a byte: the numbers 0 to 7 of the byte's bits, first of the bits that are 1 (set), then
# of the bits that are 0. In such a byte, bit k stands for lane k, that is, for a certain neighbour of a node
# (``fans``).
SET_LANES: Final = np.argsort(1 - _BITS, axis=1, kind="stable").astype(np.uint8)
SET_COUNT: Final = _BITS.sum(axis=1).astype(np.uint8)  # (256,): number of set bits per byte


class Front(NamedTuple):
    """A front (the edge of the region whose distances are known): the distances of the nodes that it has reached so
    far, and its working memory.
    """

    distance: np.ndarray  # (n + 1,) float32, ``AWAY`` if not reached
    # (n + 1,) float32, the distance from the source at which the front, on its way to the node, last turned around the
    # rim of the surface; 0 if it did not turn
    bend: np.ndarray
    queued: np.ndarray  # (n + 1,) uint8, 1 for nodes that wait for a round
    waiting: np.ndarray  # (n + 9,) uint32, the nodes that wait for a round, in the first entries
    size: np.ndarray  # (1,) int64, number of waiting nodes
    active: np.ndarray  # (n,) uint32, the active nodes of a round
    fans: Fans
    rows: Rows


class Stop(NamedTuple):
    """The condition at which a front stops: at the distance ``reach`` from its source, or earlier at the first node,
    other than a source, whose value in ``field`` (a quantity of each node) is at least ``level``.
    """

    reach: float  # metres
    field: np.ndarray  # (n,) float32; a field of length 0 never stops the front
    level: float


@njit(cache=True)
def new_front(count: int) -> Front:
    """Return a front (the edge of the region whose distances are known) that has reached no node yet, on a surface of
    ``count`` nodes.
    """
    distance, bend = np.full(count + 1, AWAY, np.float32), np.zeros(count + 1, np.float32)
    queued, waiting = np.zeros(count + 1, np.uint8), np.empty(count + LANES + 1, np.uint32)
    size, active = np.zeros(1, np.int64), np.empty(count, np.uint32)
    return Front(distance, bend, queued, waiting, size, active, empty_fans(count), empty_rows(count))


@njit(cache=True)
def start_at(front: Front, sources: np.ndarray) -> None:
    """Reset the front, so that it starts at the nodes ``sources`` (s,) int32. These nodes get the distance 0 and wait
    for the first round.
    """
    front.distance[:] = AWAY
    front.bend[:] = 0.0
    front.queued[:] = 0
    front.size[0] = 0
    for source in sources:
        if not front.queued[source]:
            front.distance[source], front.queued[source], front.waiting[front.size[0]] = 0.0, 1, source
            front.size[0] += 1


@njit(cache=True)
def march_on(mesh: MeshArrays, front: Front, band: float, stop: Stop) -> bool:
    """Advance the front until every node within the distance ``stop.reach`` of the source has its distance, or until
    the front meets a node whose value in ``stop.field`` is at least ``stop.level``. Return whether it met such a node.

    band: the range of distances, in metres, of the nodes that are active in the same round.
    """
    while front.size[0] > 0:
        count, low = _next_round(front, band)
        if low > stop.reach:
            break
        active = front.active[:count]
        if len(stop.field) > 0 and _meets(stop, front.distance, active):
            return True
        fill_fans(mesh, active, front.fans)
        gather(front.fans, front.distance, front.bend, active, front.rows)
        find_candidates(front.rows.flat, count)
        _update_rings(front, active)
        if len(mesh.link_node) > 0:
            _follow_links(mesh, front, active)
    return False


@njit(cache=True)
def _next_round(front: Front, band: float) -> tuple:
    """Begin a round: write to ``front.active`` the waiting nodes whose distance exceeds the distance of the nearest
    waiting node by at most ``band``. Return the number of these nodes, and the distance of the nearest.
    """
    distance, waiting = front.distance, front.waiting
    low, waits = AWAY, front.size[0]
    for k in range(waits):
        own = distance[waiting[k]]
        low = own if own < low else low
    threshold = low + np.float32(band)
    count, left = np.int64(0), np.int64(0)
    for k in range(waits):
        node = waiting[k]
        now = np.uint8(distance[node] <= threshold)
        front.active[count] = node
        waiting[left] = node
        count += np.int64(now)
        left += 1 - np.int64(now)
        front.queued[node] = 1 - now
    front.size[0] = left
    return count, low


@njit(cache=True)
def _meets(stop: Stop, distance: np.ndarray, active: np.ndarray) -> bool:
    met = False
    for k in range(len(active)):
        met |= stop.field[active[k]] >= stop.level and 0.0 < distance[active[k]] < stop.reach
    return met


@njit(cache=True)
def _update_rings(front: Front, active: np.ndarray) -> None:
    """Replace the distances of the active nodes' neighbours by the candidate distances that are shorter. A node whose
    distance is reduced waits for a later round.

    The inner loop, over a node's neighbours, has no branches, since the processor would mispredict half of them, which
    takes time.
    """
    distance, bend, queued, table = front.distance, front.bend, front.queued, front.rows.table
    end = front.size[0]
    for k in range(len(active)):
        updated = np.int64(table[k, UPDATED])
        for spot in range(SET_COUNT[updated]):
            lane = SET_LANES[updated, spot]
            other = front.fans.near[active[k], lane]
            candidate, turned = table[k, CANDIDATE + lane], table[k, CANDIDATE_BEND + lane]
            before, before_bend, waits = distance[other], bend[other], queued[other]
            nearer = np.uint8(candidate < before) | (np.uint8(candidate == before) & np.uint8(turned < before_bend))
            distance[other] = min(candidate, before)
            bend[other] = turned if nearer else before_bend
            front.waiting[end] = other
            end += np.int64(nearer & (waits ^ np.uint8(1)))
            queued[other] = waits | nearer
    front.size[0] = end


@njit(cache=True)
def _follow_links(mesh: MeshArrays, front: Front, active: np.ndarray) -> None:
    """Follow the links (edges outside the pixel grid) of the active nodes: the node at the other end of a link gets the
    distance of the active node plus the length of the link, where this is shorter.
    """
    distance, bend, table = front.distance, front.bend, front.rows.table
    for k in range(len(active)):
        node, own, turned = active[k], table[k, OWN], table[k, OWN_BEND]
        for spot in range(mesh.link_start[node], mesh.link_start[node + 1]):
            other = mesh.link_node[spot]
            candidate = own + mesh.link_length_m[spot]
            if candidate < distance[other] or (candidate == distance[other] and turned < bend[other]):
                distance[other], bend[other] = candidate, turned
                if not front.queued[other]:
                    front.queued[other] = 1
                    front.waiting[front.size[0]] = other
                    front.size[0] += 1


# width of the band of distances in which nodes are active in the same round, in mean edge lengths; with a narrower
# band, more rounds are needed, with a wider band, more nodes are active twice
BAND: Final = 0.7
SAMPLED_EDGES: Final = 128  # number of edges sampled for the mean edge length; it affects only the speed


def geodesic_distance(surface: Surface, sources: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """Return a field of geodesic distances for each source: the distance of every node from this source.

    sources (s,) int: nodes. Returns (s, n) float32 metres; inf for nodes that are not connected to the source or beyond
    ``max_distance_m``. Raises ValueError for a source that is not a node (such as -1 of a missed anchor), and for nodes
    whose position is not finite.
    """
    nodes = check_sources(surface, sources, max_distance_m)
    mesh = surface.arrays
    return _fields(mesh, nodes.reshape(-1, 1), np.float32(max_distance_m), band_of(mesh))


def geodesic_distance_to_set(surface: Surface, sources: np.ndarray) -> np.ndarray:
    """Return the geodesic distance (n,) float32, metres, to the nearest of the sources (s,); inf without sources."""
    nodes = check_sources(surface, sources, np.inf)
    mesh = surface.arrays
    field: np.ndarray = _fields(mesh, nodes.reshape(1, -1), np.float32(np.inf), band_of(mesh))[0]
    return field


def check_sources(surface: Surface, sources: np.ndarray, max_distance_m: float) -> np.ndarray:
    """Return the sources (s,) int32; raises ValueError as ``geodesic_distance`` does."""
    nodes = np.atleast_1d(np.asarray(sources))
    if nodes.ndim != 1 or (nodes.dtype.kind not in "iu" and len(nodes)):
        raise ValueError(f"sources must be a list of node numbers, got {nodes.dtype} of shape {nodes.shape}")
    if len(nodes) and not (nodes.min() >= 0 and nodes.max() < len(surface)):
        raise ValueError(f"sources {nodes.tolist()} are not all nodes of a surface of {len(surface)}")
    if not np.isfinite(surface.points_m).all():
        raise ValueError("the surface has nodes whose position is not finite")
    if not max_distance_m >= 0:
        raise ValueError(f"max_distance_m must not be negative, got {max_distance_m}")
    return np.ascontiguousarray(nodes, dtype=np.int32)


def band_of(mesh: MeshArrays) -> float:
    """Return the width in metres of the band of distances in which ``march_on`` activates nodes in the same round."""
    return BAND * mean_edge_m(mesh)


def mean_edge_m(mesh: MeshArrays) -> float:
    """Return the mean distance (m) between neighbouring nodes of the grid, estimated from a sample. If no node has a
    neighbour, return 1 / ``BAND``, so that ``band_of`` returns 1 m.
    """
    points, some = mesh.points_m, np.arange(0, len(mesh.points_m), max(1, len(mesh.points_m) // SAMPLED_EDGES))
    other = mesh.ring[some][:, [0, 2]]
    length = np.linalg.norm(points[other] - points[some][:, None], axis=2)[other >= 0]
    return float(length.mean()) if len(length) > 0 else 1.0 / BAND


@njit(cache=True)
def _fields(mesh: MeshArrays, sets: np.ndarray, max_distance: np.float32, band: float) -> np.ndarray:
    """Return distance fields (s, n) float32, one per set of sources (a row of ``sets`` (s, k) int32). A node's fan (the
    edges and triangles between the node and its neighbours) is the same for every source, so fans that were filled for
    one field are used again for the next field.
    """
    count = len(mesh.points_m)
    fields, front = np.empty((len(sets), count), np.float32), new_front(count)
    everywhere = Stop(np.float64(max_distance), np.empty(0, np.float32), 0.0)
    for row in range(len(sets)):
        start_at(front, sets[row])
        march_on(mesh, front, band, everywhere)
        for node in range(count):
            own = front.distance[node]
            fields[row, node] = own if own < AWAY and own <= max_distance else np.inf
    return fields
