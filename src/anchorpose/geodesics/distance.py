"""Geodesic distance on a surface by fast marching with unfolding (paper, gd of Section III): 3 to 9 mm off on average.

A front leaves the source and reaches the nodes in the order of distance. A node takes its distance from the triangle of
two reached neighbours by laying both and their distances flat, which is exact where the surface is flat; across a link
it takes the link's length. ``front`` and ``fans`` say how.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from anchorpose.geodesics.fans import AWAY
from anchorpose.geodesics.front import Stop, march_on, new_front, start_at
from anchorpose.surface.surface import MeshArrays, Surface

BAND: Final = 0.7  # of the mean edge: narrower has more rounds, wider more nodes active twice; flat in between
SAMPLED_EDGES: Final = 128  # for the mean edge, which affects speed only


def geodesic_distance(surface: Surface, sources: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """One distance field per source.

    sources (s,) int: nodes. Returns (s, n) float32 metres; inf where the source's piece of surface does not reach, or
    beyond ``max_distance_m``. An isolated source is at 0 and everything else at inf.
    Raises ValueError on a source that is not a node (a missed anchor's -1, or any node of an empty surface) and on
    nodes that are not finite.
    """
    nodes = check_sources(surface, sources, max_distance_m)
    mesh = surface.arrays
    return _fields(mesh, nodes.reshape(-1, 1), np.float32(max_distance_m), band_of(mesh))


def geodesic_distance_to_set(surface: Surface, sources: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """(n,) float32 distance in metres to the nearest of the sources (s,), inf without any; else as above."""
    nodes = check_sources(surface, sources, max_distance_m)
    mesh = surface.arrays
    field: np.ndarray = _fields(mesh, nodes.reshape(1, -1), np.float32(max_distance_m), band_of(mesh))[0]
    return field


def check_sources(surface: Surface, sources: np.ndarray, max_distance_m: float) -> np.ndarray:
    """(s,) int32 sources; raises ValueError as ``geodesic_distance``."""
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
    """Width in metres of the band of nodes that ``march_on`` takes at once."""
    return BAND * mean_edge_m(mesh)


def mean_edge_m(mesh: MeshArrays) -> float:
    """Mean distance of neighbours on the grid, from a sample of them; 1 / ``BAND`` where there are none."""
    points, some = mesh.points_m, np.arange(0, len(mesh.points_m), max(1, len(mesh.points_m) // SAMPLED_EDGES))
    other = mesh.ring[some][:, [0, 2]]
    length = np.linalg.norm(points[other] - points[some][:, None], axis=2)[other >= 0]
    return float(length.mean()) if len(length) > 0 else 1.0 / BAND


@njit(cache=True)
def _fields(mesh: MeshArrays, sets: np.ndarray, max_distance: np.float32, band: float) -> np.ndarray:
    """(s, n) float32: one field per row of sets (s, k) int32, its sources. Fans are filled once and serve all."""
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
