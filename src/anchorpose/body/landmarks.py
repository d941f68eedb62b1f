"""Geodesic distances on the patient's body itself, whatever of it is seen."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from anchorpose.body.shaped import ShapedBody
from anchorpose.body.skin_points import SkinPoints

LANDMARKS = 24  # one every 30 cm: two skin points of an adult are then told apart to within their sampling


def landmark_distances(points: SkinPoints, body: ShapedBody) -> np.ndarray:
    """(p, l) float32 metres: each skin point's distance along the mesh to ``LANDMARKS`` vertices spread over the skin.

    Along edges, hence some 5 to 10 % too long. Skin points that another piece of mesh holds are infinitely far.
    """
    faces, vertices = points.asset.faces, body.vertices
    edges = np.unique(np.sort(np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]]), axis=1), axis=0)
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    graph = csr_array((length, edges.T), shape=(len(vertices), len(vertices)))
    source = int(points.vertex[np.argmax(vertices[points.vertex, 1])])
    fields = np.empty((LANDMARKS, len(points.vertex)), np.float32)
    nearest = np.full(len(points.vertex), np.inf, np.float32)
    for row in range(LANDMARKS):
        fields[row] = dijkstra(graph, directed=False, indices=source)[points.vertex]
        nearest = np.minimum(nearest, fields[row])
        source = int(points.vertex[np.argmax(nearest)])
    return np.ascontiguousarray(fields.T)
