"""Compute which of the geodesic distances from a node are distorted by an occlusion (paper, Definitions 4 and 5).

The occlusion O is a set of nodes removed from the whole surface; the rest is the seen surface. The distance between two
nodes is distorted if it is longer on the seen surface than on the whole surface. docs/occlusion.md states which of the
paper's two propositions hold, and where they do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.research.geodesic_solvers import Solver, solve_distance
from anchorpose.surface.mesh import edges, faces, keep_nodes
from anchorpose.surface.surface import Surface

TOLERANCE_M: Final = 1e-4
"""Maximum change of a distance, in metres, with which the distance counts as undistorted, for the exact solver.

The tolerance covers rounding, and grid cells at the rim that are cut along one diagonal on the whole surface, and along
the other diagonal on the seen surface. A larger tolerance would count nodes around a corner as undistorted, since a
path that bends by 0.1 rad 0.1 m before its end is only 0.5 mm longer. With fast marching, use 4 mm, its error between
two meshes.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A part of a surface: nodes (k,) int32, ascending, and edges (e, 2) int32 with the smaller node first."""

    nodes: np.ndarray
    edges: np.ndarray

    def __contains__(self, node: int) -> bool:
        return bool(np.isin(node, self.nodes))


@dataclass(frozen=True, slots=True, eq=False)
class Occlusion:
    """A surface with and without its hidden nodes. Outside this class, a node's number is its number in ``whole``, not
    in ``seen``.
    """

    whole: Surface  # the surface without the occlusion
    hidden: np.ndarray  # (n,) bool
    seen: Surface  # the surface without the hidden nodes
    node: np.ndarray  # (m,) int32, number in ``whole`` of each node of ``seen``
    # seen nodes and edges at which the seen surface ends, but the whole surface does not
    boundary: Region
    solver: Solver
    tolerance_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """The effect of the occlusion on distances from one node."""

    occlusion: Occlusion
    # (n,) float32, by how much the distance to each node is longer than on the whole surface; inf if the node is
    # disconnected only because of the occlusion, NaN for hidden nodes and for nodes that are not connected on the whole
    # surface
    distortion_m: np.ndarray

    @property
    def bright(self) -> Region:
        """Return the bright region (Definition 4): the part of the occlusion's boundary with undistorted distances."""
        lit = np.zeros(len(self.distortion_m), bool)
        lit[self.occlusion.boundary.nodes] = True
        return _within(lit & (self.distortion_m <= self.occlusion.tolerance_m), self.occlusion.boundary.edges)

    @property
    def shadow(self) -> Region:
        """Return the shadow (Definition 5): all seen nodes with a distorted distance, and the edges between them."""
        return _within(self._dark, self.occlusion.node[edges(self.occlusion.seen)])

    @property
    def shadowed_boundary(self) -> Region:
        """Return the shadowed occlusion boundary (Definition 5): shadow nodes and edges on the occlusion's boundary."""
        on_it = np.zeros(len(self.distortion_m), bool)
        on_it[self.occlusion.boundary.nodes] = True
        return _within(on_it & self._dark, self.occlusion.boundary.edges)

    @property
    def _dark(self) -> np.ndarray:
        return self.distortion_m > self.occlusion.tolerance_m


def occlude(
    whole: Surface, hidden: np.ndarray, solver: Solver = Solver.EXACT, tolerance_m: float = TOLERANCE_M
) -> Occlusion:
    """Return the occlusion of a surface by removing its ``hidden`` nodes (n,) bool.

    Raises ValueError if ``hidden`` has another shape, or hides no node or every node.
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
    """Return the effect of the occlusion on distances from one seen node; raises ValueError for a hidden node."""
    if not 0 <= node < len(occlusion.whole) or occlusion.hidden[node]:
        raise ValueError(f"node {node} is not on the seen surface")
    place = int(np.searchsorted(occlusion.node, node))
    free = solve_distance(occlusion.whole, np.array([node]), solver=occlusion.solver)[0]
    bound = np.full(len(free), np.nan, np.float32)
    bound[occlusion.node] = solve_distance(occlusion.seen, np.array([place]), solver=occlusion.solver)[0]
    # NaN means that only edges without triangles lead to a seen node; the node then counts as disconnected
    bound[np.isnan(bound) & ~occlusion.hidden] = np.inf
    with np.errstate(invalid="ignore"):
        return Light(occlusion, np.where(np.isfinite(free), bound - free, np.nan).astype(np.float32))


def border_is_covered(lights: Sequence[Light]) -> bool:
    """Return whether the bright regions of ``lights`` (the parts of the occlusion's boundary to which distances are
    undistorted) together cover every edge of this boundary (Proposition 2).

    If this is true and Proposition 1 applies (docs/occlusion.md), every seen node has an undistorted distance to at
    least one of the nodes of ``lights``. If the result is false, some edge is not covered: the distances of nodes just
    outside this edge are distorted, whatever node of ``lights`` they are measured from.
    """
    if not lights:
        return False
    covered = {tuple(edge) for light in lights for edge in light.bright.edges.tolist()}
    return covered >= {tuple(edge) for edge in lights[0].occlusion.boundary.edges.tolist()}


def _boundary(whole: Surface, seen: Surface, node: np.ndarray) -> Region:
    """Return the outline of the seen triangles, without the outline of the whole surface."""
    ends, count = _outline(node[faces(seen)]), len(whole)
    key = ends.astype(np.int64) @ [count, 1]
    new = ends[~np.isin(key, _outline(faces(whole)).astype(np.int64) @ [count, 1])]
    return Region(np.unique(new).astype(np.int32), new.astype(np.int32))


def _outline(triangles: np.ndarray) -> np.ndarray:
    """Return (e, 2) sides that belong to one triangle only."""
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    unique, count = np.unique(sides, axis=0, return_counts=True)
    return unique[count == 1]


def _within(nodes: np.ndarray, candidates: np.ndarray) -> Region:
    """Return the nodes of a (n,) bool mask, and the candidate edges that connect two of these nodes."""
    inside = nodes[candidates].all(axis=1) if len(candidates) else np.zeros(0, bool)
    return Region(np.flatnonzero(nodes).astype(np.int32), np.sort(candidates[inside], axis=1).astype(np.int32))
