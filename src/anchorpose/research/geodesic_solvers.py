"""Provide other solvers of geodesic distance, with which fast marching is compared.

| solver | what it is | distances above ``max_distance_m`` | paths follow links and other edges without triangles |
|---|---|---|---|
| ``FAST_MARCHING`` | used by tracking; mean error from the centre 3 mm, from a limb's end 9 mm | not computed | yes |
| ``DIJKSTRA`` | along edges, as in the paper: 5 to 14 % too long | not computed | yes |
| ``HEAT`` | from the gradient of diffused heat | removed afterwards | no |
| ``EXACT`` | exact on the triangles: the reference | removed afterwards | no |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from anchorpose.errors import MissingPackage
from anchorpose.geodesics.distance import check_sources, geodesic_distance
from anchorpose.surface.links import links, pieces, straight_m
from anchorpose.surface.mesh import faces, grid_edges
from anchorpose.surface.surface import Surface

LONGEST_M: Final = 1e6  # m, maximum distance; a solver returns a greater number for a node to which no path leads


class Solver(StrEnum):
    """The solver that computes the distance."""

    FAST_MARCHING = "fast-marching"
    DIJKSTRA = "dijkstra"
    HEAT = "heat"
    EXACT = "exact"


def solve_distance(
    surface: Surface, sources: np.ndarray, max_distance_m: float = np.inf, solver: Solver = Solver.EXACT
) -> np.ndarray:
    """Return the distances (s, n) float32 in metres from each source, like ``geodesic_distance``, but by any solver.

    HEAT and EXACT use only triangles and give NaN at nodes that are connected by other edges only. HEAT and EXACT raise
    ValueError if the surface has links or if a source has edges but no triangle, and MissingPackage if their package is
    not installed.
    """
    if solver is Solver.FAST_MARCHING:
        return geodesic_distance(surface, sources, max_distance_m)
    nodes = check_sources(surface, sources, max_distance_m)
    if solver is Solver.DIJKSTRA:
        return edge_distance(surface, nodes, max_distance_m)
    return _distance_on_triangles(surface, nodes, max_distance_m, _exact if solver is Solver.EXACT else _heat)


def edge_graph(surface: Surface) -> csr_array:
    """Return (n, n) symmetric sparse matrix of edge lengths in metres, with links (edges outside the pixel grid)."""
    grid, (linked, link_length_m) = grid_edges(surface), links(surface)
    pair = np.concatenate([grid, linked])
    length = np.concatenate([straight_m(surface.points_m, grid), link_length_m]).astype(np.float64)
    row, column = np.concatenate([pair, pair[:, ::-1]]).T
    return csr_array((np.concatenate([length, length]), (row, column)), shape=(len(surface), len(surface)))


def edge_distance(surface: Surface, nodes: np.ndarray, max_distance_m: float = np.inf) -> np.ndarray:
    """Return (s, n) float32 metres: length of the shortest path along edges from each of ``nodes`` (s,) to every node.

    The length is inf for nodes that are not connected with the source, or farther than ``max_distance_m``, as in
    ``geodesic_distance``. Source: Dijkstra 1959 (doi:10.1007/BF01386390) by scipy, which stops at ``max_distance_m``.
    """
    if len(nodes) == 0:
        return np.empty((0, len(surface)), np.float32)
    return dijkstra(edge_graph(surface), directed=False, indices=nodes, limit=max_distance_m).astype(np.float32)


Prepared = Callable[[np.ndarray], np.ndarray]
"""Function that takes some vertices of a patch and returns the distance (k,) of every vertex of the patch to the
nearest of the given vertices.
"""

Solve = Callable[[np.ndarray, np.ndarray], Prepared]
"""Function that prepares one patch, given by vertices (k, 3) and faces, to be solved many times."""


def _exact(vertices_m: np.ndarray, faces: np.ndarray) -> Prepared:
    """Prepare the exact solver. Source: Mitchell, Mount and Papadimitriou 1987 (doi:10.1137/0216045) by pygeodesic."""
    try:
        from pygeodesic.geodesic import PyGeodesicAlgorithmExact
    except ImportError as error:
        raise MissingPackage("the exact geodesic distance", "pygeodesic", "references") from error
    solver = PyGeodesicAlgorithmExact(vertices_m, faces)

    def distance(vertices: np.ndarray) -> np.ndarray:
        found: np.ndarray = solver.geodesicDistances(vertices.astype(np.int32))[0]
        return found

    return distance


def _heat(vertices_m: np.ndarray, faces: np.ndarray) -> Prepared:
    """Prepare the heat method. On a body, the heat method's mean error is below 1 cm. The method does not suit whole
    rooms, since heat decays over thousands of edges.

    Source: Crane, Weischedel and Wardetzky 2013 (doi:10.1145/2516971.2516977) by potpourri3d, on its robust Laplacian.
    """
    try:
        from potpourri3d import MeshHeatMethodDistanceSolver
    except ImportError as error:
        raise MissingPackage("the heat method", "potpourri3d", "references") from error
    solver = MeshHeatMethodDistanceSolver(vertices_m, faces)

    def distance(vertices: np.ndarray) -> np.ndarray:
        return np.asarray(solver.compute_distance_multisource(vertices.tolist()), dtype=np.float64)

    return distance


@dataclass(frozen=True, slots=True, eq=False)
class TriangleMesh:
    """The triangles of a surface, which are connected only where they share a side.

    A node whose triangles share only this corner becomes several vertices, since solvers need a manifold mesh.
    """

    vertices_m: np.ndarray  # (v, 3) float64
    faces: np.ndarray  # (f, 3) int32, vertices
    node: np.ndarray  # (v,) int32, the surface's node of each vertex
    patch: np.ndarray  # (v,) int32, number of the connected patch of each vertex


def triangle_mesh(surface: Surface) -> TriangleMesh:
    """Return the triangles of ``surface.mesh.faces``, separated where they share only a corner."""
    triangle = faces(surface).astype(np.int64)
    corner = np.arange(triangle.size).reshape(triangle.shape)
    sides = np.stack([triangle, np.roll(triangle, -1, axis=1)], axis=2).reshape(-1, 2)
    ends = np.stack([corner, np.roll(corner, -1, axis=1)], axis=2).reshape(-1, 2)
    turned = sides[:, 0] > sides[:, 1]
    sides[turned], ends[turned] = sides[turned, ::-1], ends[turned, ::-1]
    order = np.lexsort(sides.T)
    same = np.flatnonzero((sides[order[1:]] == sides[order[:-1]]).all(axis=1))
    one, other = ends[order[same]].ravel(), ends[order[same + 1]].ravel()
    vertex = _components(triangle.size, one, other)
    node = np.zeros(vertex.max(initial=-1) + 1, np.int32)
    node[vertex] = triangle.ravel()
    shared = vertex.reshape(triangle.shape)
    patch = _components(len(node), shared[:, [0, 1]].ravel(), shared[:, [1, 2]].ravel())
    return TriangleMesh(surface.points_m[node].astype(np.float64), shared.astype(np.int32), node, patch)


def _components(count: int, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return (count,) int32: the connected component of each node if one[i] and other[i] are joined for every i."""
    graph = coo_array((np.ones(len(one), np.int8), (one, other)), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int32)


def _distance_on_triangles(surface: Surface, nodes: np.ndarray, max_distance_m: float, solve: Solve) -> np.ndarray:
    """Return the distance fields (s, n) float32, one per source. Each connected patch of triangles is prepared only
    once for all sources.
    """
    if len(surface.link_node):
        raise ValueError(
            "a surface with links between cameras or across gaps is more than its triangles;"
            " take fast marching or Dijkstra, or a surface of one camera without bridges"
        )
    mesh = triangle_mesh(surface)
    bare = nodes[~np.isin(nodes, mesh.node) & (surface.ring[nodes] >= 0).any(axis=1)]
    if len(bare):
        raise ValueError(f"nodes {bare.tolist()} belong to no triangle; take fast marching or Dijkstra")
    prepared: dict[int, Prepared] = {}
    fields = np.reshape([_field(surface, mesh, node, solve, prepared) for node in nodes], (len(nodes), len(surface)))
    with np.errstate(invalid="ignore"):
        return np.where(fields > max_distance_m, np.inf, fields).astype(np.float32)


def _field(surface: Surface, mesh: TriangleMesh, node: int, solve: Solve, prepared: dict[int, Prepared]) -> np.ndarray:
    """Return the distances (n,) float64 from one node.

    Distances are inf on other pieces of the surface, and NaN at nodes of the same piece that cannot be reached over
    triangles.
    """
    field = np.full(len(surface), np.inf)
    field[node] = 0.0
    sources = np.flatnonzero(mesh.node == node)
    for part in np.unique(mesh.patch[sources]):
        vertex = np.flatnonzero(mesh.patch == part)
        if part not in prepared:
            own = mesh.faces[mesh.patch[mesh.faces[:, 0]] == part]
            prepared[part] = solve(mesh.vertices_m[vertex], np.searchsorted(vertex, own).astype(np.int32))
        distance = prepared[part](np.searchsorted(vertex, sources[mesh.patch[sources] == part]))
        np.minimum.at(field, mesh.node[vertex], np.where(distance < LONGEST_M, distance, np.inf))
    piece = pieces(surface)
    return np.where(np.isinf(field) & (piece == piece[node]), np.nan, field)
