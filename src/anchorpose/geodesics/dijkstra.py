"""Geodesic distance along mesh edges, as the paper computes it: the reference, 5 to 14 % too long."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from anchorpose.geodesics.fast_marching import require_finite, require_nodes
from anchorpose.surface.mesh import edges
from anchorpose.surface.surface import Surface


def edge_graph(surface: Surface) -> csr_array:
    """(n, n) symmetric sparse matrix of edge lengths in metres."""
    pair = edges(surface)
    length = np.linalg.norm(np.subtract(*surface.points_m[pair.T].astype(np.float64)), axis=1)
    row, column = np.concatenate([pair, pair[:, ::-1]]).T
    return csr_array((np.concatenate([length, length]), (row, column)), shape=(len(surface), len(surface)))


def edge_distance(surface: Surface, sources: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """One field a source, shortest path along edges; shapes and missing values as ``geodesic_distance``.

    Source: Dijkstra 1959 (doi:10.1007/BF01386390) by scipy.
    """
    nodes = require_nodes(surface, sources)
    require_finite(surface)
    return dijkstra(edge_graph(surface), directed=False, indices=nodes, limit=max_distance_m).astype(np.float32)
