"""Maps between meshes that preserve distance: generalised multi-dimensional scaling (paper, Section III-A).

The paper calls two ways to choose a map "essentially equivalent": the least distortion (Eq. gmds), and the least sum
of Euclidean distances between full descriptors (Eq. euclidean). With eps the distortion of a map and N nodes, its cost
c is

    2 eps <= c <= N sqrt(N - 1) eps <= N sqrt(N) eps,

the upper end as the paper shows (a node is at distance 0 of itself on both meshes, so N - 1 terms count), the lower
because the worst pair stands in two rows. So both are zero for the same maps, the isometries. Otherwise their best maps
may differ: one minds the worst pair, the other all of them; the tests hold an example.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.geodesics.map_search import Criterion, search_map

SYMMETRIC_M = 0.02  # solvers other than the exact one differ by so much between the two ways of one path


@dataclass(frozen=True, slots=True, eq=False)
class MeshMatch:
    """The best map found, and how much better another could be.

    match (n_a,) int32: the node of the second mesh for each of the first, several may share one; cost: what was
    minimised; lower_bound: no map costs less; steps: branches looked at.
    """

    match: np.ndarray
    cost: float
    lower_bound: float
    steps: int

    @property
    def proven(self) -> bool:
        """Whether the map is optimal, to the micrometre."""
        return self.cost <= self.lower_bound + 1e-6

    @property
    def d_pe_m(self) -> float:
        """d_PE of the paper, where the cost is a distortion: half of it."""
        return self.cost / 2.0


def distortion(distances_a: np.ndarray, distances_b: np.ndarray, match: np.ndarray) -> float:
    """dis(phi) in metres: the greatest change of a distance between two nodes (paper, Eq. distortion).

    distances_a (n_a, n_a), distances_b (n_b, n_b) metres, finite; match (n_a,) int: phi.
    """
    return float(_change(distances_a, distances_b, match).max(initial=0.0))


def descriptor_cost(distances_a: np.ndarray, distances_b: np.ndarray, match: np.ndarray) -> float:
    """Sum over nodes of the Euclidean distance between f^U(v) and f^U(phi(v)) in metres (paper, Eq. euclidean).

    The entries of f^U(phi(v)) are taken in the order phi(v'), v' of the first mesh: without the map they have none.
    """
    return float(np.sqrt((_change(distances_a, distances_b, match) ** 2).sum(axis=1)).sum())


def match_by_distortion(distances_a: np.ndarray, distances_b: np.ndarray, max_steps: int = 2000) -> MeshMatch:
    """The map of least distortion, d_PE being half of it (paper, Eq. gmds).

    Branch and bound over all maps, exact when it ends within ``max_steps`` branches; else the best found, improved by
    moving single nodes, with the bound that was reached. Raises ValueError on what is no matrix of distances.
    """
    return _match(distances_a, distances_b, Criterion.DISTORTION, max_steps)


def match_by_descriptors(distances_a: np.ndarray, distances_b: np.ndarray, max_steps: int = 2000) -> MeshMatch:
    """The map of least ``descriptor_cost``, the paper's Euclidean matching scheme; else as ``match_by_distortion``."""
    return _match(distances_a, distances_b, Criterion.DESCRIPTORS, max_steps)


def _match(distances_a: np.ndarray, distances_b: np.ndarray, criterion: Criterion, max_steps: int) -> MeshMatch:
    a, b = _require_distances(distances_a), _require_distances(distances_b)
    if len(a) == 0 or len(b) == 0:
        raise ValueError(f"a map from {len(a)} to {len(b)} nodes does not exist")
    found = search_map(a, b, criterion, max_steps)
    cost = (distortion if criterion is Criterion.DISTORTION else descriptor_cost)(a, b, found.match)
    return MeshMatch(found.match, cost, min(found.lower_bound, cost), found.steps)


def _change(distances_a: np.ndarray, distances_b: np.ndarray, match: np.ndarray) -> np.ndarray:
    a, b, match = _require_distances(distances_a), _require_distances(distances_b), np.asarray(match)
    if match.shape != (len(a),) or (len(a) and not (match.min() >= 0 and match.max() < len(b))):
        raise ValueError(f"match of shape {match.shape} is no map from {len(a)} nodes to {len(b)}")
    change: np.ndarray = np.abs(a - b[np.ix_(match, match)])
    return change


def _require_distances(distances: np.ndarray) -> np.ndarray:
    """(n, n) float64, the mean of both ways between two nodes; ValueError where it is no matrix of distances."""
    matrix = np.asarray(distances, dtype=np.float64)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"distances between all nodes are square, got {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise ValueError("some distances are not finite: the mesh is in pieces")
    if (np.abs(matrix - matrix.T) > SYMMETRIC_M).any() or (np.diag(matrix) != 0).any():
        raise ValueError("distances must be the same both ways and zero from a node to itself")
    return (matrix + matrix.T) / 2.0
