"""Branch and bound over the maps from one mesh's nodes to another's.

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
