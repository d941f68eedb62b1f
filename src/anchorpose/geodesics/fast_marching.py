"""Geodesic distance on the organised surface by fast marching with unfolding.

A front leaves the source and reaches the nodes in the order of distance. A node takes its distance from the triangle of
two reached neighbours by laying both and their distances flat, which is exact where the surface is flat; across a link
between cameras or a bridged gap it takes the straight edge. ``front`` says how.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.geodesics.fan import AWAY, FAN, LANES
from anchorpose.geodesics.front import DESK, march_on
from anchorpose.surface.surface import Surface

BAND = 0.7  # of the mean edge: narrower has more rounds, wider more nodes with a second turn; flat in between
EDGES_LOOKED_AT = 128  # for the mean edge, which decides on speed only


def geodesic_distance(surface: Surface, sources: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """One distance field a source.

    sources (s,) int: nodes. Returns (s, n) float32 metres; inf where the source's piece of surface does not reach, or
    beyond ``max_distance_m``. Raises ValueError on a source that is no node, or nodes that are not finite.
    """
    sources = require_nodes(surface, sources)
    points = require_finite(surface)
    return march(points, surface.ring, surface.link_start, surface.link_node, sources, max_distance_m)


def geodesic_distance_to_set(surface: Surface, sources: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """(n,) float32 distance in metres to the nearest of the sources (s,); else as ``geodesic_distance``."""
    sources = require_nodes(surface, sources)
    points = require_finite(surface)
    return march_to_set(points, surface.ring, surface.link_start, surface.link_node, sources, max_distance_m)


def require_nodes(surface: Surface, sources: np.ndarray) -> np.ndarray:
    """(s,) int32 sources, or ValueError where one is no node of the surface."""
    nodes = np.atleast_1d(np.asarray(sources)).astype(np.int32)
    if ((nodes < 0) | (nodes >= len(surface))).any():
        raise ValueError(f"sources {nodes.tolist()} are not all nodes of a surface of {len(surface)}")
    return nodes


def require_finite(surface: Surface) -> np.ndarray:
    """(n, 3) float32 positions, or ValueError where one is not finite."""
    if not np.isfinite(surface.points_m).all():
        raise ValueError("the surface has nodes whose position is not finite")
    return np.ascontiguousarray(surface.points_m, dtype=np.float32)


def march(
    points: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    sources: np.ndarray,
    max_distance: float = np.inf,
) -> np.ndarray:
    """(s, n) float32: one field a source (s,) int32; inf beyond ``max_distance`` and where no edge leads.

    points (n, 3) float32 finite; ring (n, 8), link_start (n + 1,), link_node (m,) int32 of ``Surface``.
    """
    sets = np.ascontiguousarray(sources, dtype=np.int32).reshape(-1, 1)
    return _fields(points, ring, link_start, link_node, sets, np.float32(max_distance), band_of(points, ring))


def march_to_set(
    points: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    sources: np.ndarray,
    max_distance: float = np.inf,
) -> np.ndarray:
    """(n,) float32 distance to the nearest of the sources (s,); else as ``march``."""
    one_set = np.ascontiguousarray(sources, dtype=np.int32).reshape(1, -1)
    return _fields(points, ring, link_start, link_node, one_set, np.float32(max_distance), band_of(points, ring))[0]


def band_of(points: np.ndarray, ring: np.ndarray) -> float:
    """Width in metres of the band of nodes that ``march_on`` takes at once."""
    some = np.arange(0, len(points), max(1, len(points) // EDGES_LOOKED_AT))
    other = ring[some][:, [0, 2]]
    length = np.linalg.norm(points[other] - points[some][:, None], axis=2)[other >= 0]
    return BAND * float(length.mean()) if len(length) > 0 else 1.0


@njit(cache=True)
def fresh_state(count: int) -> tuple:
    """The scratch arrays of ``march_on`` for a surface of count nodes: nothing laid, nothing reached."""
    near, fan = np.empty((count, LANES), np.uint32), np.empty((count, FAN), np.float32)
    desk = np.empty((count, DESK), np.float32)  # room for all, of which a round touches a few rows
    fans = near, fan, np.full(count, 2, np.uint8), np.empty((LANES, 3), np.float32)
    work = np.empty(count, np.uint32), desk, desk.ravel()
    distance, bend = np.full(count + 1, AWAY, np.float32), np.zeros(count + 1, np.float32)
    queued, waiting = np.zeros(count + 1, np.uint8), np.empty(count + LANES + 1, np.uint32)
    return fans, (distance, bend, queued, waiting, np.zeros(1, np.int64)), work


@njit(cache=True)
def start_at(state: tuple, sources: np.ndarray) -> None:
    """Forget what was reached; the sources wait at distance 0."""
    distance, bend, queued, waiting, size = state
    distance[:] = AWAY
    bend[:] = 0.0
    queued[:] = 0
    size[0] = 0
    for source in sources:
        if not queued[source]:
            distance[source], queued[source], waiting[size[0]] = 0.0, 1, source
            size[0] += 1


@njit(cache=True)
def _fields(
    points: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    sets: np.ndarray,
    max_distance: np.float32,
    band: float,
) -> np.ndarray:
    """sets (s, k) int32: the sources of each field. Fans are laid for the first field and serve all."""
    fields = np.empty((len(sets), len(points)), np.float32)
    fans, state, work = fresh_state(len(points))
    nothing = np.empty(0, np.float32)
    for row in range(len(sets)):
        start_at(state, sets[row])
        march_on(points, ring, link_start, link_node, fans, state, work, max_distance, band, nothing, 0.0)
        for node in range(len(points)):
            own = state[0][node]
            fields[row, node] = own if own < AWAY and own <= max_distance else np.inf
    return fields
