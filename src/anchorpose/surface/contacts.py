"""Separate parts of the patient's body that touch, such as thigh on thigh or a hand on the trunk, at their creases.

The mesh of a depth frame connects the surfaces of parts that touch. ``decide_candidates`` decides which skin each node
shows, so that the border between two parts lies in the crease. ``cut_contacts`` then cuts the mesh where neighbouring
nodes show skin that is far apart on the body.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numba import njit

from anchorpose.isolation.components import find_root, unite
from anchorpose.surface.surface import ExpectedSkin, MeshArrays, SkinArrays, Surface, geodesic_lower_bound

# 1/rad; in a path, an edge counts as longer than it is, by its length times this factor times its inward fold in
# radians; an edge that folds by 3 degrees counts as twice as long
CREASE_COST: Any = np.float32(20.0)
# m, minimum distance along the body between the skin points that the two ends of a contact's edge show; smaller
# distances are no evidence of a contact, since neighbouring skin points are 3 cm apart
LEAST_APART_M: Any = np.float32(0.07)
# rad (6 degrees per edge), minimum fold that gives evidence of a contact. Between neighbouring nodes, smooth skin folds
# by less than this, so it is not cut even if an arm is wrongly predicted to lie on it
LEAST_CREASE: Any = np.float32(0.10)
# minimum sine of the angle between an edge and the skin at one of its ends, for the edge to count as a step. For
# example, the mesh has a step at the rim of a hand on the trunk
LEAST_STEP: Final = 0.6
# m; if these three limits are kept, even an edge without fold or step gives evidence of a contact. The edge's ends must
# show skin points more than SHOWN_APART_M apart on the body. Each end of the edge must be within SHOWN_NEAR_M of the
# skin point that it shows (along the skin, the prediction may be off by half a limb) and within SHOWN_OFF_M of the
# tangent plane there
SHOWN_APART_M: Any = np.float32(0.25)
SHOWN_NEAR_M: Any = np.float32(0.06)
SHOWN_OFF_M: Any = np.float32(0.02)


@njit(cache=True, nogil=True)
def decide_candidates(mesh: MeshArrays, candidates: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """Return (n,) int32: the skin point that each node shows, chosen from the node's two candidates (n, 2) int32; -1 =
    none.

    The decision spreads along the mesh from nodes with one candidate skin point to nodes with two candidates, on
    shortest paths; paths over creases count as longer. Of a node's two candidates, the node takes the candidate that is
    nearer, along the body, to the skin point that the preceding node on the path shows. The algorithm is label
    correcting (a node is decided again whenever a shorter path to it is found), so the order of the nodes does not
    matter.
    """
    points, normals, ring = mesh.points_m, mesh.normals, mesh.ring
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
            apart2 = np.float32(0.0)
            for axis in range(3):
                apart2 += (points[p, axis] - points[q, axis]) ** 2
            fold = max(crease(points, normals, p, q), np.float32(0.0))
            reached = cost[p] + np.sqrt(apart2) * (np.float32(1.0) + CREASE_COST * fold)
            if reached < cost[q]:
                one, two = candidates[q, 0], candidates[q, 1]
                to_one = geodesic_lower_bound(landmarks, skin[p], one)
                nearer = to_one <= geodesic_lower_bound(landmarks, skin[p], two)
                cost[q], skin[q] = reached, one if nearer else two
                if not waiting[q]:
                    queue[last] = q
                    last = (last + 1) % (count + 1)
                    waiting[q] = True
    return skin


def cut_contacts(surface: Surface, expected: ExpectedSkin) -> Surface:
    """Return the surface without edges between touching limbs. surface: with ``skin`` from ``assign_skin``.

    A contact is a connected set of edges whose ends show skin that is far apart on the body. A contact is cut if at
    least half of its edges fold inwards, form a step, or have ends that are certainly on different parts
    (``SHOWN_APART_M``).
    """
    ring = _cut(surface.arrays, surface.skin, expected.arrays, np.float32(LEAST_STEP))
    return replace(surface, ring=ring)


@njit(cache=True, nogil=True)
def _cut(mesh: MeshArrays, skin: np.ndarray, expected: SkinArrays, least_step: np.float32) -> np.ndarray:
    """Return the array ``ring`` (each node's neighbours) without the edges of the contacts (between touching parts of
    the body) that are cut. skin (n,) int32: the field of ``Surface``.
    """
    points, normals, ring = mesh.points_m, mesh.normals, mesh.ring
    count = len(points)
    seam = np.arange(count).astype(np.int32)  # union-find forest: the nodes of one contact get one root
    edge = np.empty((4 * count, 2), np.int32)
    apart = np.empty(4 * count, np.float32)
    cuts = 0
    for p in range(count):
        for k in range(4):
            q = ring[p, k]
            if q < 0 or skin[p] < 0 or skin[q] < 0 or skin[p] == skin[q]:
                continue
            apart[cuts] = geodesic_lower_bound(expected.landmarks_m, skin[p], skin[q])
            if apart[cuts] > LEAST_APART_M:
                edge[cuts, 0], edge[cuts, 1] = p, k
                cuts += 1
                unite(seam, np.int64(p), np.int64(q))
    if cuts == 0:
        return ring
    evidence = np.zeros(count, np.int32)
    for c in range(cuts):
        p, q = edge[c, 0], ring[edge[c, 0], edge[c, 1]]
        shown = (
            apart[c] > SHOWN_APART_M
            and _near_skin(points, np.int64(p), expected, skin[p])
            and _near_skin(points, np.int64(q), expected, skin[q])
        )
        folds = crease(points, normals, p, q) > LEAST_CREASE or _steps(points, normals, p, q, least_step)
        evidence[find_root(seam, np.int64(p))] += 1 if shown or folds else -1
    ring = ring.copy()
    for c in range(cuts):
        p, k = edge[c, 0], edge[c, 1]
        if evidence[find_root(seam, np.int64(p))] >= 0:
            ring[ring[p, k], (k + 4) % 8] = -1
            ring[p, k] = -1
    return ring


@njit(cache=True, nogil=True)
def _near_skin(points: np.ndarray, node: Any, skin: SkinArrays, under: int) -> bool:
    """Return whether a node lies near the expected place of the skin point ``under`` that it shows: within
    ``SHOWN_NEAR_M`` of this point and within ``SHOWN_OFF_M`` of the tangent plane there.
    """
    squared, along = np.float32(0.0), np.float32(0.0)
    for axis in range(3):
        gap = points[node, axis] - skin.points_m[under, axis]
        squared += gap * gap
        along += gap * skin.normals[under, axis]
    return bool(squared < SHOWN_NEAR_M * SHOWN_NEAR_M and abs(along) < SHOWN_OFF_M)


@njit(cache=True, nogil=True)
def _steps(points: np.ndarray, normals: np.ndarray, p: int, q: int, least_step: np.float32) -> bool:
    """Return whether the edge between nodes p and q rises steeply from the skin at p or at q."""
    apart2, from_p, from_q = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for axis in range(3):
        gap = points[q, axis] - points[p, axis]
        apart2 += gap * gap
        from_p += gap * normals[p, axis]
        from_q += gap * normals[q, axis]
    return bool(max(abs(from_p), abs(from_q)) > least_step * np.sqrt(apart2))


@njit(cache=True, nogil=True)
def crease(points: np.ndarray, normals: np.ndarray, p: int, q: int) -> np.float32:
    """Return the inward fold of the skin from p to q: the turn of the normal, radians, positive if concave."""
    apart2, turn = np.float32(0.0), np.float32(0.0)
    for axis in range(3):
        gap = points[q, axis] - points[p, axis]
        apart2 += gap * gap
        turn -= gap * (normals[q, axis] - normals[p, axis])
    return turn / np.sqrt(max(apart2, np.float32(1e-12)))
