"""Geodesic distance on a surface by fast marching (paper, gd of Section III): 3 to 9 mm off on average."""

from __future__ import annotations

import numpy as np

from anchorpose.geodesics.fast_marching import march, march_from_set
from anchorpose.surface.surface import Surface


def geodesic_distance(surface: Surface, sources: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """One distance field per source.

    sources (s,) int: nodes. Returns (s, n) float32 metres; inf where the source's piece of surface does not reach, or
    beyond ``max_distance_m``. An isolated source is at 0 and everything else at inf.
    Raises ValueError on a source that is not a node (a missed anchor's -1, or any node of an empty surface) and on
    nodes that are not finite.
    """
    nodes, points = check_sources(surface, sources, max_distance_m)
    return march(points, *_edges(surface), nodes, max_distance_m)


def geodesic_distance_to_set(surface: Surface, sources: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """(n,) float32 distance in metres to the nearest of the sources (s,), inf without any; else as above."""
    nodes, points = check_sources(surface, sources, max_distance_m)
    return march_from_set(points, *_edges(surface), nodes, max_distance_m)


def check_sources(surface: Surface, sources: np.ndarray, max_distance_m: float) -> tuple[np.ndarray, np.ndarray]:
    """(s,) int32 sources and (n, 3) float32 positions of the surface; raises ValueError as ``geodesic_distance``."""
    nodes, points = _require_nodes(surface, sources), _require_finite(surface)
    if not max_distance_m >= 0:
        raise ValueError(f"max_distance_m must not be negative, got {max_distance_m}")
    return nodes, points


def _edges(surface: Surface) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return surface.ring, surface.link_start, surface.link_node, surface.link_length_m


def _require_nodes(surface: Surface, sources: np.ndarray) -> np.ndarray:
    """(s,) int32 sources, or ValueError where one is no node of the surface."""
    nodes = np.atleast_1d(np.asarray(sources))
    if nodes.ndim != 1 or (nodes.dtype.kind not in "iu" and len(nodes)):
        raise ValueError(f"sources must be a list of node numbers, got {nodes.dtype} of shape {nodes.shape}")
    if len(nodes) and not (nodes.min() >= 0 and nodes.max() < len(surface)):
        raise ValueError(f"sources {nodes.tolist()} are not all nodes of a surface of {len(surface)}")
    return nodes.astype(np.int32)


def _require_finite(surface: Surface) -> np.ndarray:
    """(n, 3) float32 positions, or ValueError where one is not finite."""
    if not np.isfinite(surface.points_m).all():
        raise ValueError("the surface has nodes whose position is not finite")
    return np.ascontiguousarray(surface.points_m, dtype=np.float32)
