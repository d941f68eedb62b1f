"""Geodesic distance on the organised surface by fast marching with unfolding.

A front leaves the source and reaches the nodes in the order of distance. A node takes its distance from the triangle of
two reached neighbours by laying both and their distances flat, which is exact where the surface is flat; across a link
it takes the link's length. ``front`` says how.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.geodesics.front import AWAY, DESK, FAN, LANES, march_on

BAND = 0.7  # of the mean edge: narrower has more rounds, wider more nodes with a second turn; flat in between
EDGES_LOOKED_AT = 128  # for the mean edge, which decides on speed only


def march(
    points: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    link_length: np.ndarray,
    sources: np.ndarray,
    max_distance: float = np.inf,
) -> np.ndarray:
    """(s, n) float32: one field a source (s,) int32; inf beyond ``max_distance`` and where no edge leads.

    points (n, 3) float32 finite; ring (n, 8), link_start (n + 1,), link_node (m,) int32, link_length (m,) float32 of
    ``Surface``. Nothing is checked here: ``distance.geodesic_distance`` is the way in.
    """
    sets = np.ascontiguousarray(sources, dtype=np.int32).reshape(-1, 1)
    return _fields(
        points, ring, link_start, link_node, link_length, sets, np.float32(max_distance), band_of(points, ring)
    )


def march_from_set(
    points: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    link_length: np.ndarray,
    sources: np.ndarray,
    max_distance: float = np.inf,
) -> np.ndarray:
    """(n,) float32 distance to the nearest of the sources (s,); else as ``march``."""
    one_set = np.ascontiguousarray(sources, dtype=np.int32).reshape(1, -1)
    band = band_of(points, ring)
    return _fields(points, ring, link_start, link_node, link_length, one_set, np.float32(max_distance), band)[0]


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
    wide = desk.view(np.complex128), fan.view(np.complex128)
    work = np.empty(count, np.uint32), desk, desk.ravel(), wide[0], wide[1]
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
    link_length: np.ndarray,
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
        march_on(points, ring, link_start, link_node, link_length, fans, state, work, max_distance, band, nothing, 0.0)
        for node in range(len(points)):
            own = state[0][node]
            fields[row, node] = own if own < AWAY and own <= max_distance else np.inf
    return fields
