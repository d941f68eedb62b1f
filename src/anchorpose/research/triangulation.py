"""The surface as triangles alone, for solvers that know nothing else.

Triangles hang together where they share a side. A single common corner is no passage: there the node is two vertices,
as solvers of manifold meshes want it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from anchorpose.surface.links import pieces
from anchorpose.surface.mesh import faces
from anchorpose.surface.surface import Surface

LONGEST_M = 1e6
"""Solvers mark by huge numbers what they did not reach."""


@dataclass(frozen=True, slots=True, eq=False)
class TriangleMesh:
    """vertices_m (v, 3) float64; faces (f, 3) int32 of vertices; node (v,) int32: the surface's node of each vertex,
    some nodes twice; patch (v,) int32: which triangles that hang together each vertex belongs to."""

    vertices_m: np.ndarray
    faces: np.ndarray
    node: np.ndarray
    patch: np.ndarray


Solve = Callable[[np.ndarray, np.ndarray], Callable[[np.ndarray], np.ndarray]]
"""Prepares one patch, vertices (k, 3) and faces; then some of its vertices to the distance (k,) to the nearest."""


def triangle_mesh(surface: Surface) -> TriangleMesh:
    """The triangles of ``surface.mesh.faces``, split where they meet in a single corner."""
    triangle = faces(surface).astype(np.int64)
    corner = np.arange(triangle.size).reshape(triangle.shape)
    sides = np.stack([triangle, np.roll(triangle, -1, axis=1)], axis=2).reshape(-1, 2)
    ends = np.stack([corner, np.roll(corner, -1, axis=1)], axis=2).reshape(-1, 2)
    turned = sides[:, 0] > sides[:, 1]
    sides[turned], ends[turned] = sides[turned, ::-1], ends[turned, ::-1]
    order = np.lexsort(sides.T)
    same = np.flatnonzero((sides[order[1:]] == sides[order[:-1]]).all(axis=1))
    one, other = ends[order[same]].ravel(), ends[order[same + 1]].ravel()
    vertex = _classes(triangle.size, one, other)
    node = np.zeros(vertex.max(initial=-1) + 1, np.int32)
    node[vertex] = triangle.ravel()
    shared = vertex.reshape(triangle.shape)
    patch = _classes(len(node), shared[:, [0, 1]].ravel(), shared[:, [1, 2]].ravel())
    return TriangleMesh(surface.points_m[node].astype(np.float64), shared.astype(np.int32), node, patch)


def fields_on_triangles(surface: Surface, nodes: np.ndarray, max_distance_m: float, solve: Solve) -> np.ndarray:
    """(s, n) float32, one field a source; a patch is prepared once for all of them."""
    mesh = _require_triangles(surface, nodes)
    prepared: dict[int, Callable[[np.ndarray], np.ndarray]] = {}
    fields = [_field(surface, mesh, nodes[row : row + 1], solve, prepared) for row in range(len(nodes))]
    return _cut(np.reshape(fields, (len(nodes), len(surface))), max_distance_m)


def field_on_triangles(surface: Surface, nodes: np.ndarray, max_distance_m: float, solve: Solve) -> np.ndarray:
    """(n,) float32, the distance to the nearest of the nodes."""
    return _cut(_field(surface, _require_triangles(surface, nodes), nodes, solve, {}), max_distance_m)


def _require_triangles(surface: Surface, nodes: np.ndarray) -> TriangleMesh:
    """The mesh, or ValueError where triangles do not say how far it is."""
    if len(surface.link_node):
        raise ValueError(
            "a surface with links between cameras or across gaps is more than its triangles;"
            " take fast marching or Dijkstra, or a surface of one camera without bridges"
        )
    mesh = triangle_mesh(surface)
    hanging = nodes[~np.isin(nodes, mesh.node) & (surface.ring[nodes] >= 0).any(axis=1)]
    if len(hanging):
        raise ValueError(f"nodes {hanging.tolist()} belong to no triangle; take fast marching or Dijkstra")
    return mesh


def _field(
    surface: Surface,
    mesh: TriangleMesh,
    nodes: np.ndarray,
    solve: Solve,
    prepared: dict[int, Callable[[np.ndarray], np.ndarray]],
) -> np.ndarray:
    """(n,) float64; NaN on the nodes' pieces of surface where no triangle leads to, inf beyond them."""
    over = np.full(len(surface), np.inf)
    over[nodes] = 0.0
    sources = np.flatnonzero(np.isin(mesh.node, nodes))
    for part in np.unique(mesh.patch[sources]):
        vertex = np.flatnonzero(mesh.patch == part)
        if part not in prepared:
            own = mesh.faces[mesh.patch[mesh.faces[:, 0]] == part]
            prepared[part] = solve(mesh.vertices_m[vertex], np.searchsorted(vertex, own).astype(np.int32))
        distance = prepared[part](np.searchsorted(vertex, sources[mesh.patch[sources] == part]))
        np.minimum.at(over, mesh.node[vertex], np.where(distance < LONGEST_M, distance, np.inf))
    piece = pieces(surface)
    return np.where(np.isinf(over) & np.isin(piece, piece[nodes]), np.nan, over)


def _classes(count: int, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(count,) int32: numbers of the classes that the pairs join."""
    graph = coo_array((np.ones(len(one), np.int8), (one, other)), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int32)


def _cut(field: np.ndarray, max_distance_m: float) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.where(field > max_distance_m, np.inf, field).astype(np.float32)
