"""Geodesic distance by the heat method: a smooth approximation, fast once a surface has been factored."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from anchorpose.errors import MissingPackage
from anchorpose.geodesics.triangulation import field_on_triangles, fields_on_triangles
from anchorpose.surface.surface import Surface


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
