"""The Laplace-Beltrami operator of a surface's triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csc_array
from scipy.sparse.csgraph import connected_components

from anchorpose.features.intrinsic_delaunay import intrinsic_delaunay
from anchorpose.surface.mesh import faces
from anchorpose.surface.surface import Surface


@dataclass(frozen=True, slots=True, eq=False)
class Laplacian:
    """node (v,) int32: the surface's nodes that belong to a triangle; all else is in their order.

    stiffness (v, v) float64 sparse, symmetric, positive semidefinite, no positive entry off its diagonal: cotangent
    weights; mass_m2 (v,) float64: the area nearer to the node than to any other (Voronoi's), which unlike thirds of
    triangles does not depend on which diagonal cuts a square; piece (v,) int32: which triangles that
    hang together, by a corner at least, each node belongs to.
    """

    node: np.ndarray
    stiffness: csc_array
    mass_m2: np.ndarray
    piece: np.ndarray


def surface_laplacian(surface: Surface) -> Laplacian:
    """Cotangent weights with lumped mass on the intrinsic Delaunay triangulation; Neumann's condition at the outline.

    Links carry no triangles and so no heat. Triangles with a node whose position is not finite are left out.
    """
    triangles = faces(surface)
    return mesh_laplacian(surface.points_m, triangles[np.isfinite(surface.points_m).all(axis=1)[triangles].all(axis=1)])


def mesh_laplacian(points_m: np.ndarray, triangles: np.ndarray) -> Laplacian:
    """The same for any triangles (f, 3) int of points (n, 3) metres, also where three share an edge."""
    node, own = np.unique(triangles, return_inverse=True)
    count = len(node)
    edges, values = intrinsic_delaunay(np.asarray(points_m, np.float64)[node], own.reshape(-1, 3))
    tail, head = edges.T
    weight = np.where(tail == head, 0.0, values[:, 0] / 2.0)  # halves, for each triangle has a front and a back
    off = coo_array((np.tile(-weight, 2), (np.append(tail, head), np.append(head, tail))), shape=(count, count)).tocsc()
    diagonal = np.bincount(np.append(tail, head), np.tile(weight, 2), count)
    stiffness = (off + coo_array((diagonal, (np.arange(count), np.arange(count))), shape=(count, count))).tocsc()
    mass_m2 = np.bincount(np.append(tail, head), np.tile(values[:, 1] / 2.0, 2), count)
    piece = connected_components(coo_array((np.ones(len(tail), np.int8), (tail, head)), shape=(count, count)), False)[1]
    return Laplacian(node.astype(np.int32), csc_array(stiffness), mass_m2, piece.astype(np.int32))
