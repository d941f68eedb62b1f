"""The exact geodesic distance on the triangles: the reference all others are held to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from anchorpose.errors import MissingPackage
from anchorpose.geodesics.triangulation import field_on_triangles, fields_on_triangles
from anchorpose.surface.surface import Surface


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
