"""Geodesic distance on a surface: one way in, four solvers behind it (paper, gd of Section III).

| solver | what it is | early stop | links and edges without triangles |
|---|---|---|---|
| ``FAST_MARCHING`` | the default: off by 3 mm from the centre, 9 mm from a tip | while solving | are paths |
| ``DIJKSTRA`` | along edges, as the paper does: 5 to 14 % too long | while solving | are paths |
| ``HEAT`` | from the gradient of diffused heat | cut afterwards | are no paths |
| ``EXACT`` | exact on the triangles: the reference | cut afterwards | are no paths |
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from anchorpose.geodesics.dijkstra import edge_distance, edge_distance_to_set
from anchorpose.geodesics.exact import exact_distance, exact_distance_to_set
from anchorpose.geodesics.fast_marching import march, march_from_set
from anchorpose.geodesics.heat import heat_distance, heat_distance_to_set
from anchorpose.surface.surface import Surface


class Solver(StrEnum):
    """Who computes the distance."""

    FAST_MARCHING = "fast-marching"
    DIJKSTRA = "dijkstra"
    HEAT = "heat"
    EXACT = "exact"


REFERENCES = {
    Solver.DIJKSTRA: (edge_distance, edge_distance_to_set),
    Solver.HEAT: (heat_distance, heat_distance_to_set),
    Solver.EXACT: (exact_distance, exact_distance_to_set),
}
"""Each solver beside the default: one field a source, and one field for the nearest of all."""


def geodesic_distance(
    surface: Surface,
    sources: np.ndarray,
    max_distance_m: float = np.inf,
    solver: Solver = Solver.FAST_MARCHING,
) -> np.ndarray:
    """One distance field a source.

    sources (s,) int: nodes. Returns (s, n) float32 metres; inf where the source's piece of surface does not reach, or
    beyond ``max_distance_m``. A source beside nothing is at 0 and all else at inf. HEAT and EXACT know triangles only:
    NaN at nodes that hang on by other edges.
    Raises ValueError on a source that is no node (a missed anchor's -1, or any node of an empty surface), on nodes
    that are not finite, and where HEAT or EXACT is asked for a surface with links or a source without triangles;
    MissingPackage where a reference's package is not installed.
    """
    nodes, points = _require_nodes(surface, sources), _require_finite(surface)
    _refuse_negative(max_distance_m)
    if solver is Solver.FAST_MARCHING:
        return march(points, *_edges(surface), nodes, max_distance_m)
    return REFERENCES[solver][0](surface, nodes, max_distance_m)


def geodesic_distance_to_set(
    surface: Surface,
    sources: np.ndarray,
    max_distance_m: float = np.inf,
    solver: Solver = Solver.FAST_MARCHING,
) -> np.ndarray:
    """(n,) float32 distance in metres to the nearest of the sources (s,), inf without any; else as above."""
    nodes, points = _require_nodes(surface, sources), _require_finite(surface)
    _refuse_negative(max_distance_m)
    if solver is Solver.FAST_MARCHING:
        return march_from_set(points, *_edges(surface), nodes, max_distance_m)
    return REFERENCES[solver][1](surface, nodes, max_distance_m)


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


def _refuse_negative(max_distance_m: float) -> None:
    if not max_distance_m >= 0:
        raise ValueError(f"max_distance_m must not be negative, got {max_distance_m}")
