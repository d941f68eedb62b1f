"""Maps between meshes that preserve distance: generalised multi-dimensional scaling (paper, Section III-A).

The paper calls two ways to choose a map "essentially equivalent": the least distortion (Eq. gmds), and the least sum
of Euclidean distances between full descriptors (Eq. euclidean). With eps the distortion of a map and N nodes, its cost
c is

    2 eps <= c <= N sqrt(N - 1) eps <= N sqrt(N) eps,

the upper end as the paper shows (a node is at distance 0 of itself on both meshes, so N - 1 terms count), the lower
because the worst pair stands in two rows. So both are zero for the same maps, the isometries. Otherwise their best maps
may differ: one minds the worst pair, the other all of them; the tests hold an example.

Branch and bound over the maps from one mesh's nodes to another's.

A branch says where some nodes go. What each other node would cost at each place, against those alone, bounds every map
of the branch from below: the sum or maximum of each node's cheapest place.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

SLACK = 1e-9  # metres; branches no better than this are cut


class Criterion(Enum):
    """What a map should keep small."""

    DISTORTION = "the greatest change of a distance"
    DESCRIPTORS = "the sum of Euclidean distances between full descriptors"


@dataclass(frozen=True, slots=True, eq=False)
class FoundMap:
    """match (n_a,) int32; lower_bound: no map costs less; steps: branches looked at."""

    match: np.ndarray
    lower_bound: float
    steps: int


@dataclass(frozen=True, slots=True, eq=False)
class _Branch:
    """estimate: lower bound; table (n_a, n_b) before ``node`` goes to ``place``; match (n_a,), -1 = open."""

    estimate: float
    table: np.ndarray
    match: np.ndarray
    node: int
    place: int


def search_map(a: np.ndarray, b: np.ndarray, criterion: Criterion, max_steps: int) -> FoundMap:
    """Depth first, the cheapest place first; every complete map is improved before it becomes the one to beat.

    a (n_a, n_a), b (n_b, n_b): symmetric distances.
    """
    floor = _cheapest_rows(a, b, criterion)
    start = np.zeros_like(floor)
    best, least = improve_map(a, b, floor.argmin(axis=1), criterion)
    stack = _children(start, floor, np.full(len(a), -1, np.int32), criterion, least)
    steps = 0
    while stack and steps < max_steps:
        branch = stack.pop()
        if branch.estimate >= least - SLACK:
            continue
        steps += 1
        table, match = _decided(a, b, branch, criterion)
        if (match >= 0).all():
            improved, cost = improve_map(a, b, match, criterion)
            if cost < least:
                best, least = improved, cost
        elif _bound(table, floor, criterion) < least - SLACK:
            stack += _children(table, floor, match, criterion, least)
    return FoundMap(best.astype(np.int32), min([least, *(branch.estimate for branch in stack)]), steps)


def improve_map(a: np.ndarray, b: np.ndarray, match: np.ndarray, criterion: Criterion) -> tuple[np.ndarray, float]:
    """Moves single nodes to better places as long as that helps; returns the map and its cost."""
    match = match.copy()
    change = np.abs(a - b[np.ix_(match, match)])
    cost = _map_cost(change, criterion)
    moved = True
    while moved:
        moved = False
        rows = change.max(axis=1) if criterion is Criterion.DISTORTION else (change**2).sum(axis=1)
        for node in np.argsort(-rows, kind="stable"):
            others = np.arange(len(a)) != node
            aside = np.abs(a[node] - b[:, match])  # (n_b, n_a): the node's row if it went to each place
            aside[:, node] = 0.0
            if criterion is Criterion.DISTORTION:
                costs = np.maximum(aside.max(axis=1), change[np.ix_(others, others)].max(initial=0.0))
            else:
                squares = (change**2).sum(axis=1) - change[:, node] ** 2
                squares = np.maximum(squares, 0.0) + aside**2
                squares[:, node] = (aside**2).sum(axis=1)
                costs = np.sqrt(squares).sum(axis=1)
            place = int(costs.argmin())
            if costs[place] < cost - SLACK:
                match[node], cost, moved = place, float(costs[place]), True
                change[node] = change[:, node] = aside[place]
    return match, cost


def _map_cost(change: np.ndarray, criterion: Criterion) -> float:
    if criterion is Criterion.DISTORTION:
        return float(change.max(initial=0.0))
    return float(np.sqrt((change**2).sum(axis=1)).sum())


def _cheapest_rows(a: np.ndarray, b: np.ndarray, criterion: Criterion) -> np.ndarray:
    """(n_a, n_b): what a node at least costs at a place, every other node going where it suits this one best."""
    floor = np.empty((len(a), len(b)))
    for place, row in enumerate(b):
        ordered = np.sort(row)
        after = np.clip(np.searchsorted(ordered, a), 1, max(len(ordered) - 1, 1))
        upper = ordered[np.minimum(after, len(ordered) - 1)]
        nearest = np.minimum(np.abs(a - upper), np.abs(a - ordered[after - 1]))
        if criterion is Criterion.DISTORTION:
            floor[:, place] = nearest.max(axis=1)
        else:
            floor[:, place] = np.sqrt((nearest**2).sum(axis=1))
    return floor


def _costs(table: np.ndarray, floor: np.ndarray, criterion: Criterion) -> np.ndarray:
    """(n_a, n_b) lower bound of each node's row at each place; inf where it is decided otherwise."""
    return np.maximum(table if criterion is Criterion.DISTORTION else np.sqrt(table), floor)


def _bound(table: np.ndarray, floor: np.ndarray, criterion: Criterion) -> float:
    cheapest = _costs(table, floor, criterion).min(axis=1)
    return float(cheapest.max() if criterion is Criterion.DISTORTION else cheapest.sum())


def _decided(a: np.ndarray, b: np.ndarray, branch: _Branch, criterion: Criterion) -> tuple[np.ndarray, np.ndarray]:
    """The table and the map after one more node has its place."""
    match = branch.match.copy()
    match[branch.node] = branch.place
    change = np.abs(a[:, branch.node, None] - b[None, :, branch.place])
    table = np.maximum(branch.table, change) if criterion is Criterion.DISTORTION else branch.table + change**2
    table[branch.node, np.arange(len(b)) != branch.place] = np.inf
    return table, match


def _children(
    table: np.ndarray, floor: np.ndarray, match: np.ndarray, criterion: Criterion, least: float
) -> list[_Branch]:
    """One branch for each place of the node with the fewest places left, the cheapest last."""
    costs = _costs(table, floor, criterion)
    cheapest = costs.min(axis=1)
    if criterion is Criterion.DISTORTION:
        estimates = np.maximum(costs, cheapest.max())
    else:
        estimates = costs + (cheapest.sum() - cheapest)[:, None]
    left = (estimates < least - SLACK).sum(axis=1)
    node = int(np.where(match < 0, left, len(floor[0]) + 1).argmin())
    places = np.flatnonzero(estimates[node] < least - SLACK)
    places = places[np.argsort(-costs[node, places], kind="stable")]
    return [_Branch(float(estimates[node, place]), table, match, node, int(place)) for place in places]


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
