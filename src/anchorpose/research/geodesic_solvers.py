"""Other solvers of geodesic distance, to compare fast marching with.

| solver | what it is | early stop | links and edges without triangles |
|---|---|---|---|
| ``FAST_MARCHING`` | what tracking uses: off by 3 mm from the centre, 9 mm from a tip | while solving | are paths |
| ``DIJKSTRA`` | along edges, as the paper does: 5 to 14 % too long | while solving | are paths |
| ``HEAT`` | from the gradient of diffused heat | cut afterwards | are no paths |
| ``EXACT`` | exact on the triangles: the reference | cut afterwards | are no paths |
"""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from anchorpose.errors import MissingPackage
from anchorpose.geodesics.distance import check_sources, geodesic_distance, geodesic_distance_to_set
from anchorpose.research.triangulation import field_on_triangles, fields_on_triangles
from anchorpose.surface.links import links, straight_m
from anchorpose.surface.mesh import grid_edges
from anchorpose.surface.surface import Surface


class Solver(StrEnum):
    """Who computes the distance."""

    FAST_MARCHING = "fast-marching"
    DIJKSTRA = "dijkstra"
    HEAT = "heat"
    EXACT = "exact"


def solve_distance(
    surface: Surface, sources: np.ndarray, max_distance_m: float = np.inf, solver: Solver = Solver.EXACT
) -> np.ndarray:
    """As ``geodesic_distance``, by any solver; HEAT and EXACT know triangles only.

    Those two give NaN at nodes that are joined by other edges only, and raise ValueError where the surface has links
    or a source has no triangle; MissingPackage where their package is not installed.
    """
    if solver is Solver.FAST_MARCHING:
        return geodesic_distance(surface, sources, max_distance_m)
    nodes = check_sources(surface, sources, max_distance_m)
    return _REFERENCES[solver][0](surface, nodes, max_distance_m)


def solve_distance_to_set(
    surface: Surface, sources: np.ndarray, max_distance_m: float = np.inf, solver: Solver = Solver.EXACT
) -> np.ndarray:
    """As ``geodesic_distance_to_set``, by any solver."""
    if solver is Solver.FAST_MARCHING:
        return geodesic_distance_to_set(surface, sources, max_distance_m)
    nodes = check_sources(surface, sources, max_distance_m)
    return _REFERENCES[solver][1](surface, nodes, max_distance_m)


def edge_graph(surface: Surface) -> csr_array:
    """(n, n) symmetric sparse matrix of edge lengths in metres, links included."""
    grid, (linked, link_length_m) = grid_edges(surface), links(surface)
    pair = np.concatenate([grid, linked])
    length = np.concatenate([straight_m(surface.points_m, grid), link_length_m]).astype(np.float64)
    row, column = np.concatenate([pair, pair[:, ::-1]]).T
    return csr_array((np.concatenate([length, length]), (row, column)), shape=(len(surface), len(surface)))


def edge_distance(surface: Surface, nodes: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """(s, n) float32: shortest path along edges from each of the nodes (s,); missing values as ``geodesic_distance``.

    Source: Dijkstra 1959 (doi:10.1007/BF01386390) by scipy, which stops at ``max_distance_m``.
    """
    if len(nodes) == 0:
        return np.empty((0, len(surface)), np.float32)
    return dijkstra(edge_graph(surface), directed=False, indices=nodes, limit=max_distance_m).astype(np.float32)


def edge_distance_to_set(surface: Surface, nodes: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """(n,) float32: shortest path along edges to the nearest of the nodes."""
    if len(nodes) == 0:
        return np.full(len(surface), np.inf, np.float32)
    graph = edge_graph(surface)
    return dijkstra(graph, directed=False, indices=nodes, limit=max_distance_m, min_only=True).astype(np.float32)


def exact_distance(surface: Surface, nodes: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """(s, n) float32, one field a source; cut at ``max_distance_m`` afterwards.

    Source: Mitchell, Mount and Papadimitriou 1987 (doi:10.1137/0216045) by pygeodesic.
    """
    return fields_on_triangles(surface, nodes, max_distance_m, _windows)


def exact_distance_to_set(surface: Surface, nodes: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """(n,) float32: exact distance to the nearest of the nodes."""
    return field_on_triangles(surface, nodes, max_distance_m, _windows)


def _windows(vertices_m: np.ndarray, faces: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    try:
        from pygeodesic.geodesic import PyGeodesicAlgorithmExact
    except ImportError as error:
        raise MissingPackage("the exact geodesic distance", "pygeodesic", "references") from error
    solver = PyGeodesicAlgorithmExact(vertices_m, faces)

    def distance(vertices: np.ndarray) -> np.ndarray:
        found: np.ndarray = solver.geodesicDistances(vertices.astype(np.int32))[0]
        return found

    return distance


def heat_distance(surface: Surface, nodes: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """(s, n) float32, one field a source; factored once a patch, cut at ``max_distance_m`` afterwards.

    Source: Crane, Weischedel and Wardetzky 2013 (doi:10.1145/2516971.2516977) by potpourri3d, on its robust
    Laplacian. On a body within 1 cm on average; heat dies out over thousands of edges, so this is not for whole rooms.
    """
    return fields_on_triangles(surface, nodes, max_distance_m, _factor)


def heat_distance_to_set(surface: Surface, nodes: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """(n,) float32: heat from all the nodes at once."""
    return field_on_triangles(surface, nodes, max_distance_m, _factor)


def _factor(vertices_m: np.ndarray, faces: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    try:
        from potpourri3d import MeshHeatMethodDistanceSolver
    except ImportError as error:
        raise MissingPackage("the heat method", "potpourri3d", "references") from error
    solver = MeshHeatMethodDistanceSolver(vertices_m, faces)

    def distance(vertices: np.ndarray) -> np.ndarray:
        return np.asarray(solver.compute_distance_multisource(vertices.tolist()), dtype=np.float64)

    return distance


_REFERENCES = {
    Solver.DIJKSTRA: (edge_distance, edge_distance_to_set),
    Solver.HEAT: (heat_distance, heat_distance_to_set),
    Solver.EXACT: (exact_distance, exact_distance_to_set),
}
"""Each solver beside fast marching: one field per source, and one field for the nearest of all."""
