"""Measure how far two surfaces are from isometric (equal in all distances along the surface) by the paper's d_PE.

d_PE is half the smallest distortion of any map from the first surface to the second.

The paper defines d_PE by the equation whose LaTeX label is eq:gmds. The distortion of a map is the greatest change of a
distance (equation eq:distortion; Bronstein, Bronstein and Kimmel 2006, doi:10.1073/pnas.0508601103). Branch and bound
finds the map of smallest distortion exactly, for few samples. For matching surfaces, the module ``gmds`` uses the
changes of all distances, not only the greatest, since this distinguishes maps better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.research.features.gmds import APART_M, farthest_points
from anchorpose.surface.surface import Surface


@dataclass(frozen=True, slots=True, eq=False)
class LeastDistortion:
    """A map of smallest distortion between two sets of points."""

    # (n_a,) int32, for each point of the first set, its point in the second set, which several points may share
    match: np.ndarray
    distortion_m: float  # m, distortion of this map
    proven: bool  # whether it is proven that no other map has a smaller distortion

    @property
    def d_pe_m(self) -> float:
        """Return d_PE, metres: half of the distortion; unless ``proven``, this is only an upper bound of d_PE."""
        return self.distortion_m / 2.0


def distortion_m(distances_a: np.ndarray, distances_b: np.ndarray, match: np.ndarray) -> float:
    """Return the distortion of a map in metres: the greatest change of a distance between two points.

    distances_a (n_a, n_a), distances_b (n_b, n_b): metres, within each set. match (n_a,) int.
    """
    return float(np.abs(distances_a.astype(np.float64) - distances_b[np.ix_(match, match)]).max(initial=0.0))


def least_distortion(
    distances_a: np.ndarray, distances_b: np.ndarray, max_branches: int = 1_000_000
) -> LeastDistortion:
    """Return the map from the first set of points to the second whose greatest change of a distance is smallest.

    distances_a (n_a, n_a), distances_b (n_b, n_b): metres, symmetric, zero from a point to itself, finite. Raises
    ValueError for other distances, and if only the second set is empty.
    """
    a, b = _require_distances(distances_a), _require_distances(distances_b)
    if len(a) and not len(b):
        raise ValueError("points have no place in an empty set")
    match, branches = _search(a, b, max_branches)
    return LeastDistortion(match, distortion_m(a, b, match), branches < max_branches)


def surface_distance(one: Surface, other: Surface, samples: int = 8, candidates: int = 60) -> LeastDistortion:
    """Compute d_PE, half the smallest distortion of any map, from samples (nodes of the surface ``one``) to candidates
    (nodes of the surface ``other``). In both sets, nodes lie as far apart as possible.

    Distances are computed by fast marching, and paths may follow links (edges outside the pixel grid). Between separate
    pieces of a surface, distances are ``APART_M``, far greater than any distance on a body.
    """
    nodes = farthest_points(one, samples)[0], farthest_points(other, candidates)[0]
    return least_distortion(_among(one, nodes[0]), _among(other, nodes[1]))


def _among(surface: Surface, nodes: np.ndarray) -> np.ndarray:
    """Return the symmetric matrix (k, k) float64 of distances between nodes."""
    fields = np.minimum(geodesic_distance(surface, nodes)[:, nodes], APART_M).astype(np.float64)
    return np.asarray((fields + fields.T) / 2.0)


def _require_distances(distances: np.ndarray) -> np.ndarray:
    matrix = np.asarray(distances, dtype=np.float64)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"distances between all points are square, got {matrix.shape}")
    if not np.isfinite(matrix).all() or (np.diag(matrix) != 0.0).any() or not np.allclose(matrix, matrix.T):
        raise ValueError("distances are finite, the same both ways and zero from a point to itself")
    return matrix


@njit(cache=True, error_model="numpy")
def _search(a: np.ndarray, b: np.ndarray, max_branches: int) -> tuple[np.ndarray, int]:
    """Search depth first, trying the best place first; return the best map and the number of branches visited.

    worst[level, i, v] is the greatest change of a distance between point i and the points placed so far if i is mapped
    to v. A branch is cut as soon as some point has no place with less distortion than the best map so far.
    """
    depth, count = len(a), len(b)
    best, least = np.zeros(depth, np.int32), np.inf
    worst, order = np.zeros((depth + 1, depth, count)), np.zeros((depth, count), np.int64)
    turn, chosen = np.zeros(depth + 1, np.int64), np.zeros(depth, np.int32)
    level, branches = 0, 0
    if depth > 0:
        order[0] = np.arange(count)
    while 0 <= level < depth and branches < max_branches:
        place = order[level, min(turn[level], count - 1)]
        if turn[level] == count or worst[level, level, place] >= least:
            level -= 1
            continue
        turn[level] += 1
        branches += 1
        chosen[level] = place
        bound = worst[level, level, place]
        for i in range(depth):
            lowest = np.inf
            for v in range(count):
                change = max(worst[level, i, v], abs(a[i, level] - b[v, place]))
                worst[level + 1, i, v] = change
                lowest = min(lowest, change)
            if i > level:
                bound = max(bound, lowest)
        if level == depth - 1:
            reached = 0.0
            for i in range(depth):
                reached = max(reached, worst[level, i, chosen[i]])
            if reached < least:
                least = reached
                best[:] = chosen
        elif bound < least:
            level += 1
            turn[level] = 0
            order[level] = np.argsort(worst[level, level])
    return best, branches
