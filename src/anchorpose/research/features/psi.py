"""Compute the paper's match of a node (Section IV): the middle of psi.

Psi is the set of nodes of the other frame whose distances to some anchors are similar to the node's. On a limb, psi is
a band that ends at the outline, where the sensor stops seeing the skin. The average position of such a clipped band
lies too far inside, so nodes at the outline would never be chosen as matches. The unclipped middle is the place at
which psi's distances equal the node's distances; it is found by a least-squares regression of position on distance over
psi. If nothing clips psi, this place is the average position. The regression needs three anchors: with only the two
feet, the distances determine only how far along a leg a node is, and the regression would lead to a place beside the
leg.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from anchorpose.track_tree.hypotheses import GateConfig, anchor_subsets

NONE: Final = -1  # placeholder in a subset that has fewer anchors than other subsets
# m2, ridge of the regression; it prevents a shift of psi's middle in directions in which distances hardly vary
RIDGE_M2: Final = 0.002**2
FEWEST: Final = 8  # minimum number of nodes of psi for a regression on three distances


def subsets_with_pieces(source: np.ndarray, target: np.ndarray, found: np.ndarray, size: int) -> np.ndarray:
    """Return (s, size): all subsets of ``size`` of the found anchors, and smaller subsets, filled up with ``NONE``.

    found (5,) bool. source (n, 5), target (m, 5): distances of the nodes of two frames to the anchors, not finite if no
    path leads from the anchor to the node. If paths lead from fewer than ``size`` anchors to a piece of surface, no
    subset of this size has distances there; the anchors that reach the piece then form its only subset.
    """
    whole = anchor_subsets(found, size)
    reached = [row for table in (source, target) for row in np.unique(np.isfinite(table) & found, axis=0)]
    few = sorted({tuple(np.flatnonzero(row)) for row in reached if 0 < row.sum() < min(size, found.sum())})
    filled = [[*anchors, *[NONE] * (whole.shape[1] - len(anchors))] for anchors in few]
    return np.concatenate([whole, np.array(filled, np.int64).reshape(len(filled), whole.shape[1])])


def match_by_psi(
    source: np.ndarray,
    target: np.ndarray,
    places_m: np.ndarray,
    subsets: np.ndarray,
    gate: GateConfig,
    unclipped: bool,
    squared: bool = False,
) -> np.ndarray:
    """Return (k, s) int32: for each source node and subset, the node of psi nearest to psi's middle; -1 if psi is
    empty.

    source (k, 5), target (n, 5): metres. places_m (n, 3): positions of the target nodes. subsets: the result of
    ``subsets_with_pieces``; a filled-up subset applies only if paths lead from all its anchors, and from no other, to
    the node or its match. squared: True = as the paper's inequality is printed, the squared norm (m²) of the
    differences of distance is below e_max (m), the limit that ``gate`` sets; False = the norm itself is below e_max.
    """
    known = subsets != NONE
    distance = np.where(known, source[:, np.where(known, subsets, 0)], 0.0)
    bound = gate.anchor_bound_m + gate.surface_bound_per_m * distance.sum(axis=2) / known.sum(axis=1)
    bits = (1 << np.arange(source.shape[1])).astype(np.int64)
    reached = [(np.isfinite(table) @ bits).astype(np.int64) for table in (source, target)]
    only = np.where(known.all(axis=1), NONE, (np.where(known, 1 << np.maximum(subsets, 0), 0)).sum(axis=1))
    return _match_all(
        source.astype(np.float64),
        target.astype(np.float64),
        places_m.astype(np.float64),
        subsets,
        bound if squared else bound**2,
        reached[0],
        reached[1],
        only,
        unclipped,
    )


@njit(cache=True)
def _match_all(
    source: np.ndarray,
    target: np.ndarray,
    places: np.ndarray,
    subsets: np.ndarray,
    limit2: np.ndarray,
    reached: np.ndarray,
    target_reached: np.ndarray,
    only: np.ndarray,
    unclipped: bool,
) -> np.ndarray:
    """Compute the result of ``match_by_psi``.

    limit2 (k, s): bound on the squared norm of the differences of distance to the anchors. reached (k,), target_reached
    (n,): for each node of source and target, the sum of the bits (1, 2, 4, ...) of the anchors from which a path leads
    to it. only (s,): the sum of the bits of a filled-up subset's anchors, -1 for other subsets.
    """
    match = np.full((len(source), len(subsets)), -1, np.int32)
    psi, offset = np.empty(len(target), np.int64), np.empty((len(target), subsets.shape[1]))
    columns, near, possible = np.ascontiguousarray(target.T), np.empty(len(target), np.int8), psi.copy()
    fewest = _fewest_anchors(subsets)
    for node in range(len(source)):
        widest2 = 0.0
        for s in range(len(subsets)):
            if np.isfinite(limit2[node, s]):  # if a distance of the node is not finite, psi is empty
                widest2 = max(widest2, limit2[node, s])
        count = _possible(source[node], columns, widest2, fewest, near, possible)
        for s in range(len(subsets)):
            alone = only[s] >= 0 and reached[node] != only[s]
            size = 0
            for other in possible[:count]:
                if alone and target_reached[other] != only[s]:
                    continue
                apart2 = 0.0
                for k in range(subsets.shape[1]):
                    anchor = subsets[s, k]
                    offset[size, k] = target[other, anchor] - source[node, anchor] if anchor >= 0 else 0.0
                    apart2 += offset[size, k] ** 2
                    if not apart2 < limit2[node, s]:
                        break
                psi[size] = other
                size += apart2 < limit2[node, s]
            if size:
                match[node, s] = _middle(places, psi[:size], offset[:size], unclipped and only[s] < 0)
    return match


@njit(cache=True)
def _fewest_anchors(subsets: np.ndarray) -> int:
    fewest = subsets.shape[1]
    for s in range(len(subsets)):
        fewest = min(fewest, (subsets[s] >= 0).sum())
    return fewest


@njit(cache=True)
def _possible(
    distance: np.ndarray, columns: np.ndarray, limit2: float, fewest: int, near: np.ndarray, possible: np.ndarray
) -> int:
    """Fill ``possible`` with the candidates for psi: nodes with at least ``fewest`` similar distances to the anchors.
    Return their number.
    """
    near[:] = 0
    for anchor in range(len(columns)):
        column, own = columns[anchor], distance[anchor]
        for other in range(len(column)):
            off = column[other] - own
            near[other] += off * off < limit2
    count = 0
    for other in range(len(near)):
        possible[count] = other
        count += near[other] >= fewest
    return count


@njit(cache=True)
def _middle(places: np.ndarray, psi: np.ndarray, offset: np.ndarray, unclipped: bool) -> int:
    """Return the node of ``psi`` (m,) that is nearest to psi's middle: the average position of its nodes or, if
    ``unclipped`` and if psi has at least ``FEWEST`` nodes, its unclipped middle (see ``_shift``).

    offset (m, a): the distances of psi's nodes to the anchors minus the source node's distances.
    """
    middle = np.zeros(3)
    for m in range(len(psi)):
        middle += places[psi[m]]
    middle /= len(psi)
    if unclipped and len(psi) >= FEWEST:
        middle -= _shift(places, psi, offset, middle)
    best, nearest = psi[0], np.inf
    for m in range(len(psi)):
        away = 0.0
        for axis in range(3):
            away += (places[psi[m], axis] - middle[axis]) ** 2
        if away < nearest:
            nearest, best = away, psi[m]
    return best


@njit(cache=True)
def _shift(places: np.ndarray, psi: np.ndarray, offset: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return the vector (3,), metres, from the unclipped middle to psi's average position, by the regression.

    The unclipped middle is the place at which psi's distances equal those of the source node.
    """
    anchors = offset.shape[1]
    mean = np.zeros(anchors)
    for m in range(len(psi)):
        mean += offset[m]
    mean /= len(psi)
    spread, pull = np.zeros((anchors, anchors)), np.zeros((anchors, 3))
    for m in range(len(psi)):
        for a in range(anchors):
            off = offset[m, a] - mean[a]
            for b in range(anchors):
                spread[a, b] += off * (offset[m, b] - mean[b])
            for axis in range(3):
                pull[a, axis] += off * (places[psi[m], axis] - middle[axis])
    for a in range(anchors):
        spread[a, a] += RIDGE_M2 * len(psi)
    slope = np.linalg.solve(spread, pull)
    shift = np.zeros(3)
    for a in range(anchors):
        for axis in range(3):
            shift[axis] += slope[a, axis] * mean[a]
    return shift
