"""Compute the full unoccluded descriptor f^U (paper, Definition 1), the distances between all nodes, as a reference."""

from __future__ import annotations

import numpy as np

from anchorpose.errors import DegenerateGeometry
from anchorpose.research.geodesic_solvers import Solver, solve_distance, triangle_mesh
from anchorpose.surface.surface import Surface


def full_descriptor(surface: Surface, solver: Solver = Solver.EXACT) -> np.ndarray:
    """Return (n, n) float32 metres: row v is f^U(v), its entries in the order of the surface's nodes.

    That order is the mesh's own: rows of two meshes can be compared only through a map between their nodes (see
    ``features.gmds``). One solve per node: for meshes of a few hundred.
    Raises DegenerateGeometry unless the triangles make one simply connected surface, as the definition asks: a hole is
    an occlusion, and distances around it differ from those on the whole skin.
    """
    mesh = triangle_mesh(surface)
    parts = mesh.patch.max(initial=-1) + 1
    if parts != 1 or len(np.unique(mesh.node)) < len(surface):
        raise DegenerateGeometry(f"the surface is not a single sheet of triangles ({parts} pieces)")
    holes = count_holes(mesh.faces, len(mesh.node))
    if holes:
        raise DegenerateGeometry(f"the surface is not simply connected: {holes} holes")
    return solve_distance(surface, np.arange(len(surface)), solver=solver)


def count_holes(faces: np.ndarray, vertices: int) -> int:
    """Return the number of holes of a connected sheet: 1 - (V - E + F), by Euler's characteristic."""
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    return 1 - (vertices - len(np.unique(sides, axis=0)) + len(faces))
