"""Search the track tree of each node (its possible matches over several frames) for the branch that is nearest to the
node's predicted places (paper, Section V).

A branch is a chain of matches from frame to frame: it has one node in each of up to N_Tr frames (the depth of the
tree), and all its nodes may show the same place on the skin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numba import njit

from anchorpose.settings import Count, Positive, settings


@settings
class TreeConfig:
    """Settings of the track tree."""

    # m, cost of each frame without a match: twice the paper's bound on an anchor's error
    missed_cost_m: Positive = 0.10
    # maximum number of branches visited in the tree of one node; the rest of the tree is pruned. The limit is rarely
    # reached: in a test without it, with ten noisy subsets of anchors, the search visited fewer than 50 branches for
    # each of 3650 nodes
    max_branches: Count = 200


class Support(IntEnum):
    """The source of a node's place in the next frame: a match or the prediction; ``UNKNOWN`` without a place."""

    MATCHED = 0  # the place is a hypothesis on the best branch
    TOO_FAR = 1  # the place is the prediction, since all hypotheses are too far away from the prediction
    NO_HYPOTHESIS = 2  # the place is the prediction, since no subset of anchors finds the node in the next frame
    UNKNOWN = 3  # the place is unknown, since a branch cannot be chosen without a prediction


@dataclass(frozen=True, slots=True, eq=False)
class TrackResult:
    """The global hypothesis: the first match on the best branch of each source node."""

    match: np.ndarray  # (m,) int32, node of the next surface, -1 = missed
    # (m,) float32 m, cost of the best branch (smaller is better). Each match on the branch costs its distance to the
    # predicted place, plus its entry in the argument ``costs_m`` of ``best_branches``. Each frame without a match costs
    # ``missed_cost_m``. The cost is NaN if the node has no predicted places
    score: np.ndarray
    subset: np.ndarray  # (m,) int32, column (subset) in which the match is found, -1 = missed
    support: np.ndarray  # (m,) int8 of ``Support``


def best_branches(
    matches: Sequence[np.ndarray],
    positions_m: Sequence[np.ndarray],
    predicted_m: np.ndarray,
    config: TreeConfig,
    costs_m: Sequence[np.ndarray] | None = None,
) -> TrackResult:
    """Score every branch, R = sum of ed(node, predicted node) over the levels (ed: Euclidean distance), and keep the
    best branch of each source node.

    matches: entry l is (n_l, s_l) int, the match in surface l + 1 of each node of surface l under each subset, -1 =
    missed; surface 0 is the source, and levels may have different numbers of subsets. positions_m: entry l is (n_(l+1),
    3), the nodes of surface l + 1, world. predicted_m (m, depth, 3): predicted place of each source node, level by
    level; NaN = unknown. costs_m: for each entry of matches, (n_l, s_l) metres added to the distance, such as the
    dissimilarity of the two nodes; None = nothing is added.

    A missed node has no children: its branch ends and costs ``missed_cost_m`` for each remaining level. A branch may
    also end, at the same cost for each remaining level, although its last node has children. The search is branch and
    bound: children are visited in order of distance, and a branch is left as soon as it costs at least as much as the
    best branch so far. So the best branch is found exactly, unless the tree is pruned (``max_branches``). Among
    branches with equal costs, the branch of the first subset is taken. Raises ValueError if the shapes do not fit or a
    match points outside its surface.
    """
    _check(matches, positions_m, predicted_m)
    costs = [np.zeros(level.shape, np.float32) for level in matches] if costs_m is None else costs_m
    first = np.cumsum([0, *(len(level) for level in matches)]).astype(np.int64)
    first_node = np.cumsum([0, *(len(level) for level in positions_m)]).astype(np.int64)
    levels = _Levels(
        _as_wide(matches),
        _as_wide(costs, np.float32),
        first,
        np.concatenate(positions_m).astype(np.float32, copy=False),
        first_node,
    )
    predicted = np.ascontiguousarray(predicted_m, dtype=np.float32)
    match, score, subset = _search(levels, predicted, np.float32(config.missed_cost_m), config.max_branches)
    return TrackResult(match, score, subset, _support(matches[0], match, score))


def _as_wide(matches: Sequence[np.ndarray], dtype: type = np.int32) -> np.ndarray:
    """Join the arrays (n_l, s_l) of all levels l into a single array (sum of n_l, largest s_l), one level after
    another; a level with fewer subsets is padded with -1, which means a missed match.
    """
    wide = np.full((sum(map(len, matches)), max(level.shape[1] for level in matches)), -1, dtype=dtype)
    row = 0
    for level in matches:
        wide[row : row + len(level), : level.shape[1]] = level
        row += len(level)
    return wide


def _support(hypotheses: np.ndarray, match: np.ndarray, score: np.ndarray) -> np.ndarray:
    support = np.where((hypotheses >= 0).any(axis=1), Support.TOO_FAR, Support.NO_HYPOTHESIS)
    support[match >= 0] = Support.MATCHED
    support[np.isnan(score)] = Support.UNKNOWN
    return support.astype(np.int8)


def _check(matches: Sequence[np.ndarray], positions_m: Sequence[np.ndarray], predicted_m: np.ndarray) -> None:
    depth = len(matches)
    if depth == 0 or len(positions_m) != depth:
        raise ValueError(f"a tree needs as many surfaces as levels, got {depth} levels and {len(positions_m)} surfaces")
    if predicted_m.shape != (len(matches[0]), depth, 3):
        raise ValueError(f"predictions must be {(len(matches[0]), depth, 3)}, got {predicted_m.shape}")
    for level, (match, nodes) in enumerate(zip(matches, positions_m, strict=True)):
        if match.size and match.max() >= len(nodes):
            raise ValueError(f"level {level} points at node {match.max()} of {len(nodes)}")
        if level and len(match) != len(positions_m[level - 1]):
            raise ValueError(f"level {level} has {len(match)} nodes, its surface {len(positions_m[level - 1])}")


@njit(cache=True)
def _children(
    row: np.ndarray,
    extra: np.ndarray,
    nodes: np.ndarray,
    target: np.ndarray,
    node: np.ndarray,
    cost: np.ndarray,
    subset: np.ndarray,
) -> int:
    """List the different children of a node by increasing distance from ``target`` plus extra cost (insertion sort,
    stable); return the number of children.

    If several subsets lead to the same child, the subset with the least cost counts; among equal costs, the first
    subset.
    """
    count = 0
    for s in range(len(row)):
        child = row[s]
        if child < 0:
            continue
        cheaper = False
        for k in range(len(row)):
            cheaper = cheaper or (row[k] == child and (extra[k] < extra[s] or (extra[k] == extra[s] and k < s)))
        if cheaper:
            continue
        d_x, d_y, d_z = nodes[child, 0] - target[0], nodes[child, 1] - target[1], nodes[child, 2] - target[2]
        distance = np.float32(np.sqrt(d_x * d_x + d_y * d_y + d_z * d_z)) + extra[s]
        place = count
        while place > 0 and cost[place - 1] > distance:
            node[place], cost[place], subset[place] = node[place - 1], cost[place - 1], subset[place - 1]
            place -= 1
        node[place], cost[place], subset[place] = child, distance, s
        count += 1
    return count


class _Levels(NamedTuple):
    """The matches, costs and nodes of all levels (steps from a frame to the next), one level after another."""

    matches: np.ndarray  # (sum of n_l, s) int32, as in ``best_branches``
    costs_m: np.ndarray  # (sum of n_l, s) m, cost added to each match
    first: np.ndarray  # first row of each level in ``matches`` and ``costs_m``
    positions_m: np.ndarray
    first_node: np.ndarray  # first row of each level in ``positions_m``


class _Branch(NamedTuple):
    """The branch under search. Each array has one row or entry for each level of the tree (step from a frame to the
    next).
    """

    node: np.ndarray  # children of the present node, by increasing cost
    cost: np.ndarray  # m, costs of the children in ``node``, ascending
    subset: np.ndarray  # subsets of anchors that lead to the children in ``node``
    children: np.ndarray  # number of children of the present node
    following: np.ndarray  # index of the next child to visit
    so_far: np.ndarray  # m, cost of the branch before this level adds a child


@njit(cache=True)
def _search(
    levels: _Levels, predicted: np.ndarray, missed_cost: np.float32, max_branches: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return match, score and subset of each source node as in ``TrackResult``."""
    m, depth, _ = predicted.shape
    width = levels.matches.shape[1]
    match, subset = np.full(m, -1, dtype=np.int32), np.full(m, -1, dtype=np.int32)
    score = np.full(m, np.nan, dtype=np.float32)
    branch = _Branch(
        np.empty((depth, width), dtype=np.int32),
        np.empty((depth, width), dtype=np.float32),
        np.empty((depth, width), dtype=np.int32),
        np.zeros(depth, dtype=np.int64),
        np.zeros(depth, dtype=np.int64),
        np.zeros(depth + 1, dtype=np.float32),
    )
    for i in range(m):
        if not np.isfinite(predicted[i].sum()):
            continue
        _open_level(levels, branch, 0, i, predicted[i, 0])
        chosen, score[i] = _best_branch(levels, branch, predicted[i], missed_cost, max_branches)
        if chosen >= 0:
            match[i], subset[i] = branch.node[0, chosen], branch.subset[0, chosen]
    return match, score, subset


@njit(cache=True)
def _best_branch(
    levels: _Levels, branch: _Branch, predicted: np.ndarray, missed_cost: np.float32, max_branches: int
) -> tuple[int, np.float32]:
    """Return the best branch as the index of its first child (-1 if the branch has no match), and the cost of the best
    branch.
    """
    depth = len(predicted)
    best = np.float32(depth * missed_cost)  # cost of a branch without any match
    chosen, visited, level = -1, 0, 0
    while level >= 0:
        k = branch.following[level]
        if k >= branch.children[level] or branch.so_far[level] + branch.cost[level, k] >= best:
            level -= 1  # children are sorted by cost, so the remaining children cannot be better
            continue
        total = branch.so_far[level] + branch.cost[level, k]
        branch.following[level] += 1
        visited += 1
        ended = total + np.float32(depth - 1 - level) * missed_cost
        if ended < best:
            best, chosen = ended, branch.following[0] - 1
        if visited >= max_branches:
            break
        if level + 1 < depth:
            child = branch.node[level, k]
            level += 1
            branch.so_far[level] = total
            _open_level(levels, branch, level, levels.first[level] + child, predicted[level])
    return chosen, best


@njit(cache=True)
def _open_level(levels: _Levels, branch: _Branch, level: int, row: int, target: np.ndarray) -> None:
    """List the children of a node in ``branch``, as ``_children`` does. row: the node's row in ``levels.matches``;
    target: the predicted place of the children.
    """
    nodes = levels.positions_m[levels.first_node[level] : levels.first_node[level + 1]]
    branch.following[level] = 0
    matches, extra = levels.matches[row], levels.costs_m[row]
    branch.children[level] = _children(
        matches, extra, nodes, target, branch.node[level], branch.cost[level], branch.subset[level]
    )
