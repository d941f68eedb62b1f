"""What an occlusion does to geodesic distance: bright and shadow regions (paper, Definitions 4 and 5).

The occlusion O is a set of nodes taken out of the whole surface; what is left is the seen surface. From one node the
distance to another is distorted where the way over the seen surface is longer than over the whole one. Which of the
paper's two propositions hold, and where not, is in docs/occlusion.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anchorpose.research.geodesic_solvers import Solver, solve_distance
from anchorpose.surface.mesh import edges, faces, keep_nodes
from anchorpose.surface.surface import Surface

TOLERANCE_M = 1e-4
"""What counts as undistorted with the exact solver: rounding, and cells at the rim that are cut the other way. A
generous tolerance lights what lies around the corner: a way that bends by 0.1 rad 0.1 m before its end is 0.5 mm more.
With fast marching take 4 mm, its own error between two meshes."""


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """Part of a surface: nodes (k,) int32 ascending, edges (e, 2) int32 with the smaller node first."""

    nodes: np.ndarray
    edges: np.ndarray

    def __contains__(self, node: int) -> bool:
        return bool(np.isin(node, self.nodes))


@dataclass(frozen=True, slots=True, eq=False)
class Occlusion:
    """A surface with and without the nodes that something hides.

    whole: the surface as if nothing stood in front; hidden (n,) bool; seen: what is left of it, and node (m,) int32:
    the whole surface's number of each seen node. All numbers outside this class are the whole surface's. boundary: the
    seen nodes and edges where the surface ends because of the occlusion, not where the whole one ends.
    """

    whole: Surface
    hidden: np.ndarray
    seen: Surface
    node: np.ndarray
    boundary: Region
    solver: Solver
    tolerance_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """The occlusion as one node sees it.

    distortion_m (n,) float32: by how much the way to each node is longer than over the whole surface; inf where the
    occlusion cuts it off, NaN at hidden nodes and where the whole surface does not lead either.
    """

    occlusion: Occlusion
    distortion_m: np.ndarray

    @property
    def bright(self) -> Region:
        """The bright region (Definition 4): the occlusion's boundary as far as distances to it are undistorted."""
        lit = np.zeros(len(self.distortion_m), bool)
        lit[self.occlusion.boundary.nodes] = True
        return _within(lit & (self.distortion_m <= self.occlusion.tolerance_m), self.occlusion.boundary.edges)

    @property
    def shadow(self) -> Region:
        """Shadow nodes and edges (Definition 5): everything seen to which the distance is distorted."""
        return _within(self._dark, self.occlusion.node[edges(self.occlusion.seen)])

    @property
    def shadowed_boundary(self) -> Region:
        """The shadowed occlusion boundary (Definition 5): shadow nodes and edges on the occlusion's boundary."""
        on_it = np.zeros(len(self.distortion_m), bool)
        on_it[self.occlusion.boundary.nodes] = True
        return _within(on_it & self._dark, self.occlusion.boundary.edges)

    @property
    def _dark(self) -> np.ndarray:
        return self.distortion_m > self.occlusion.tolerance_m


def occlude(
    whole: Surface, hidden: np.ndarray, solver: Solver = Solver.EXACT, tolerance_m: float = TOLERANCE_M
) -> Occlusion:
    """Take the hidden nodes (n,) bool out of a surface.

    Raises ValueError where hidden does not fit, or hides nothing or everything.
    """
    if hidden.shape != (len(whole),) or hidden.dtype != bool:
        raise ValueError(f"hidden must be ({len(whole)},) bool, got {hidden.shape} {hidden.dtype}")
    if not hidden.any() or hidden.all():
        raise ValueError("an occlusion hides some nodes and leaves others")
    if not tolerance_m >= 0:
        raise ValueError(f"tolerance_m must not be negative, got {tolerance_m}")
    seen, node = keep_nodes(whole, ~hidden), np.flatnonzero(~hidden).astype(np.int32)
    boundary = _boundary(whole, seen, node)
    return Occlusion(whole, hidden, seen, node, boundary, solver, tolerance_m)


def light_from(occlusion: Occlusion, node: int) -> Light:
    """What the occlusion does to distances from one seen node; ValueError from a hidden one."""
    if not 0 <= node < len(occlusion.whole) or occlusion.hidden[node]:
        raise ValueError(f"node {node} is not on the seen surface")
    place = int(np.searchsorted(occlusion.node, node))
    free = solve_distance(occlusion.whole, np.array([node]), solver=occlusion.solver)[0]
    bound = np.full(len(free), np.nan, np.float32)
    bound[occlusion.node] = solve_distance(occlusion.seen, np.array([place]), solver=occlusion.solver)[0]
    bound[np.isnan(bound) & ~occlusion.hidden] = np.inf  # only bare edges lead there once the triangles are gone
    with np.errstate(invalid="ignore"):
        return Light(occlusion, np.where(np.isfinite(free), bound - free, np.nan).astype(np.float32))


def border_is_covered(lights: Sequence[Light]) -> bool:
    """Whether the union of the bright regions covers the occlusion's boundary, every edge of it (Proposition 2).

    Then every seen node has an undistorted distance to at least one of the nodes that the lights stand for, where
    Proposition 1 holds (docs/occlusion.md); if not, nodes just outside a dark edge have none.
    """
    if not lights:
        return False
    covered = {tuple(edge) for light in lights for edge in light.bright.edges.tolist()}
    return covered >= {tuple(edge) for edge in lights[0].occlusion.boundary.edges.tolist()}


def _boundary(whole: Surface, seen: Surface, node: np.ndarray) -> Region:
    """Ends of the seen triangles that are no ends of the whole surface's."""
    ends, count = _ends(node[faces(seen)]), len(whole)
    key = ends.astype(np.int64) @ [count, 1]
    new = ends[~np.isin(key, _ends(faces(whole)).astype(np.int64) @ [count, 1])]
    return Region(np.unique(new).astype(np.int32), new.astype(np.int32))


def _ends(triangles: np.ndarray) -> np.ndarray:
    """(e, 2) sides that belong to one triangle only."""
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    unique, count = np.unique(sides, axis=0, return_counts=True)
    return unique[count == 1]


def _within(nodes: np.ndarray, candidates: np.ndarray) -> Region:
    """The nodes of a (n,) bool mask and those of the edges that connect two of them."""
    inside = nodes[candidates].all(axis=1) if len(candidates) else np.zeros(0, bool)
    return Region(np.flatnonzero(nodes).astype(np.int32), np.sort(candidates[inside], axis=1).astype(np.int32))
