"""Map the body's skin: compute the distances along the skin from sampled points to landmarks, and find neighbouring
sampled points and the paths between them.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from anchorpose.body.skin_points import Body, SkinPoints
from anchorpose.surface.surface import BodyMap

# m, minimum length of an edge of the mesh; on missing limbs the length would be 0, which the graph does not allow
LEAST_EDGE_M: Final = 1e-6
# number of landmarks, one every 30 cm: enough to distinguish an adult's skin points by their distances from landmarks
LANDMARKS: Final = 24


def map_body(body: Body) -> BodyMap:
    """Return the map of the body's sampled skin at rest.

    Landmarks are spread over the skin, each as far as possible from the earlier landmarks. Distances to landmarks run
    along the edges of the mesh and are about 5 % too long.
    """
    points, vertices = body.points, body.mesh.vertices
    mesh, (pairs, via) = _edge_lengths(vertices, _edges(points)), _pairs(points)
    skin = vertices[points.vertex]
    path_m = np.where(via == pairs[:, 0], 0.0, np.linalg.norm(skin[via] - skin[pairs[:, 0]], axis=1))
    path_m += np.linalg.norm(skin[via] - skin[pairs[:, 1]], axis=1)
    straight = np.linalg.norm(skin[pairs[:, 0]] - skin[pairs[:, 1]], axis=1) / np.maximum(path_m, LEAST_EDGE_M)
    return BodyMap(
        landmarks_m=_landmark_distances(mesh, points.vertex, int(np.argmax(skin[:, 1]))),
        pairs=pairs.astype(np.int32),
        via=via.astype(np.int32),
        straight=straight.astype(np.float32),
    )


@cache
def _edges(points: SkinPoints) -> np.ndarray:
    """Return the vertices (e, 2) of each edge of the mesh."""
    faces = points.asset.faces
    return np.unique(np.sort(np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]]), axis=1), axis=0)


def _edge_lengths(vertices: np.ndarray, edges: np.ndarray) -> csr_array:
    length = np.maximum(np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1), LEAST_EDGE_M)
    return csr_array((length, edges.T), shape=(len(vertices), len(vertices)))


@cache
def _pairs(points: SkinPoints) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of skin points that are neighbours or second neighbours, and the point on the path between both
    points of each pair. The pairs are computed on the mean adult, since neighbours hardly depend on a person's shape.
    """
    vertices, edges = points.asset.vertices, _edges(points)
    direct = _neighbours(_edge_lengths(vertices, edges), edges, points.vertex)
    return _second_neighbours(direct, vertices[points.vertex])


def _landmark_distances(mesh: csr_array, vertex: np.ndarray, first: int) -> np.ndarray:
    """Return the distances (p, l) float32, metres, from skin points to landmarks; first: index of the skin point
    that is the first landmark.
    """
    fields = np.empty((LANDMARKS, len(vertex)), np.float32)
    nearest, source = np.full(len(vertex), np.inf, np.float32), first
    for row in range(LANDMARKS):
        fields[row] = dijkstra(mesh, directed=False, indices=vertex[source])[vertex]
        nearest = np.minimum(nearest, fields[row])
        source = int(np.argmax(nearest))
    return np.ascontiguousarray(fields.T)


def _neighbours(mesh: csr_array, edges: np.ndarray, vertex: np.ndarray) -> np.ndarray:
    """Return pairs (e, 2) of sampled points whose cells touch. The cell of a sampled point is the set of mesh vertices
    to which no other sampled point is nearer.
    """
    _, _, nearest = dijkstra(mesh, directed=False, indices=vertex, min_only=True, return_predecessors=True)
    place = np.full(mesh.shape[0] + 1, -1)
    place[vertex] = np.arange(len(vertex))
    cell = place[np.maximum(nearest, -1)]  # no path reaches eyes and teeth (source -9999), so they belong to no cell
    cell[vertex] = np.arange(len(vertex))
    touching = np.sort(cell[edges], axis=1)
    return np.unique(touching[(touching[:, 0] >= 0) & (touching[:, 0] != touching[:, 1])], axis=0)


def _second_neighbours(direct: np.ndarray, skin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs (e, 2) of points that are neighbours or second neighbours, and the point (e,) on the path between
    both points of each pair.

    If a pair has several paths, the shortest is used. For direct neighbours, the point on the path is the first point
    of the pair.
    """
    both = np.concatenate([direct, direct[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    start = np.searchsorted(both[:, 0], np.arange(len(skin) + 1))
    steps = [np.column_stack([direct, direct[:, 0]])]
    for point in range(len(skin)):
        around = both[start[point] : start[point + 1], 1]
        one, two = (around[index] for index in np.triu_indices(len(around), 1))
        steps.append(np.stack([np.minimum(one, two), np.maximum(one, two), np.full(len(one), point)], axis=1))
    found = np.concatenate(steps)
    path_m = np.linalg.norm(skin[found[:, 0]] - skin[found[:, 2]], axis=1)
    path_m += np.linalg.norm(skin[found[:, 2]] - skin[found[:, 1]], axis=1)
    path_m[: len(direct)] = 0.0  # direct neighbours are the first rows; 0 makes their path the shortest
    order = np.lexsort((path_m, found[:, 1], found[:, 0]))
    found = found[order]
    first = np.ones(len(found), bool)
    first[1:] = (found[1:, :2] != found[:-1, :2]).any(axis=1)
    return found[first, :2], found[first, 2]
