"""Where the patient touches himself the mesh is cut again: thigh on thigh, a hand on the trunk.

A depth picture joins what touches. The expected skin says that both sides are far apart on the body, if not exactly
where they meet; the crease between them does. Nodes about the place are disputed, both sides grow into them and meet
in the crease, and all edges between the two are cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from anchorpose.surface.kinship import way_over_skin


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactConfig:
    """What makes a contact."""

    least_way_m: float = 0.07  # over the body between neighbours of the mesh; less is what skin points 3 cm apart blur
    crease_cost: float = 20.0  # growing over a fold of 3 degrees a node is twice as far as over flat skin
    least_crease: float = 0.10  # of the median edge along a contact, 0.1 = 6 degrees a node; smooth skin has none

    def __post_init__(self) -> None:
        for name in ("least_way_m", "crease_cost", "least_crease"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


def settle_skin(
    points_m: np.ndarray, normals: np.ndarray, ring: np.ndarray, candidates: np.ndarray, landmarks_m: np.ndarray,
    config: ContactConfig,
) -> np.ndarray:  # fmt: skip
    """(n,) int32 skin point of each node: of two candidates (n, 2) of ``skin_under`` the one its side of a crease has.

    Nodes with one candidate keep it and pass on which side they are; the way to them is longer over creases.
    """
    return _settle(points_m, normals, ring, candidates, landmarks_m, np.float32(config.crease_cost))


def cut_contacts(
    points_m: np.ndarray, normals: np.ndarray, ring: np.ndarray, skin: np.ndarray, landmarks_m: np.ndarray,
    config: ContactConfig,
) -> np.ndarray:  # fmt: skip
    """The ring (n, 8) without the edges that a contact made; skin (n,) of ``settle_skin``."""
    return _cut(points_m, normals, ring, skin, landmarks_m, np.float32(config.least_way_m),
                np.float32(config.least_crease))  # fmt: skip


@njit(cache=True)
def _crease(points: np.ndarray, normals: np.ndarray, p: int, q: int) -> float:
    """By how much the skin folds inwards from p to q: the change of the normal along the edge, positive if concave."""
    apart, turn = np.float32(0.0), np.float32(0.0)
    for axis in range(3):
        gap = points[q, axis] - points[p, axis]
        apart += gap * gap
        turn -= gap * (normals[q, axis] - normals[p, axis])
    return turn / np.sqrt(max(apart, np.float32(1e-12)))


@njit(cache=True)
def _settle(
    points: np.ndarray, normals: np.ndarray, ring: np.ndarray, candidates: np.ndarray, landmarks: np.ndarray,
    crease_cost: float,
) -> np.ndarray:  # fmt: skip
    """Label correcting from the nodes with one candidate into those with two."""
    count = len(points)
    skin = candidates[:, 0].copy()
    cost = np.full(count, np.inf, np.float32)
    queue = np.empty(count + 1, np.int32)
    waiting = np.zeros(count, np.bool_)
    first, last = 0, 0
    for p in range(count):
        if candidates[p, 1] >= 0 or skin[p] < 0:
            continue
        cost[p] = 0.0
        for k in range(8):
            if ring[p, k] >= 0 and candidates[ring[p, k], 1] >= 0:
                queue[last] = p
                last += 1
                waiting[p] = True
                break
    while first != last:
        p = queue[first]
        first = (first + 1) % (count + 1)
        waiting[p] = False
        for k in range(8):
            q = ring[p, k]
            if q < 0 or candidates[q, 1] < 0:
                continue
            apart = np.float32(0.0)
            for axis in range(3):
                apart += (points[p, axis] - points[q, axis]) ** 2
            reached = cost[p] + np.sqrt(apart) * (1.0 + crease_cost * max(_crease(points, normals, p, q), 0.0))
            if reached < cost[q]:
                cost[q] = reached
                one, two = candidates[q, 0], candidates[q, 1]
                nearer = way_over_skin(landmarks, skin[p], one) <= way_over_skin(landmarks, skin[p], two)
                skin[q] = one if nearer else two
                if not waiting[q]:
                    queue[last] = q
                    last = (last + 1) % (count + 1)
                    waiting[q] = True
    return skin


@njit(cache=True)
def _root(seam: np.ndarray, node: int) -> int:
    while seam[node] != node:
        seam[node] = seam[seam[node]]
        node = seam[node]
    return node


@njit(cache=True)
def _cut(
    points: np.ndarray, normals: np.ndarray, ring: np.ndarray, skin: np.ndarray, landmarks: np.ndarray,
    least_way: float, least_crease: float,
) -> np.ndarray:  # fmt: skip
    count = len(points)
    seam = np.arange(count).astype(np.int32)  # union-find: the nodes of one contact's edges
    edge = np.empty((4 * count, 2), np.int32)
    cuts = 0
    for p in range(count):
        for k in range(4):
            q = ring[p, k]
            if q < 0 or skin[p] < 0 or skin[q] < 0 or skin[p] == skin[q]:
                continue
            if way_over_skin(landmarks, skin[p], skin[q]) > least_way:
                edge[cuts, 0], edge[cuts, 1] = p, k
                cuts += 1
                one, other = _root(seam, p), _root(seam, q)
                seam[max(one, other)] = min(one, other)
    folded = np.zeros(count, np.int32)
    for c in range(cuts):
        p, q = edge[c, 0], ring[edge[c, 0], edge[c, 1]]
        folded[_root(seam, p)] += 1 if _crease(points, normals, p, q) > least_crease else -1
    ring = ring.copy()
    for c in range(cuts):
        p, k = edge[c, 0], edge[c, 1]
        if folded[_root(seam, p)] >= 0:
            ring[ring[p, k], (k + 4) % 8] = -1
            ring[p, k] = -1
    return ring
