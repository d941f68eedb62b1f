"""Where the patient touches their own body the mesh is cut again: thigh on thigh, a hand on the trunk.

A depth frame joins what touches. Neighbours of the mesh that show skin far apart on the body are not neighbours.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numba import njit

from anchorpose.surface.links import find_root, unite
from anchorpose.surface.shown_skin import crease
from anchorpose.surface.surface import ExpectedSkin, MeshArrays, SkinArrays, Surface, geodesic_lower_bound

LEAST_APART_M: Any = np.float32(0.07)  # on the body, of an edge's ends; less is within what points 3 cm apart blur
LEAST_CREASE: Any = np.float32(0.10)  # 6 degrees per node; no smooth skin of an arm predicted elsewhere has that
LEAST_STEP: Final = 0.6  # sine of the angle at which an edge leaves the skin of either end: a hand on the trunk
SHOWN_APART_M: Any = np.float32(0.25)  # parts so far apart on the body need no crease between them ...
SHOWN_NEAR_M: Any = np.float32(0.06)  # ... where both nodes are as near as that to the skin point that they show ...
SHOWN_OFF_M: Any = np.float32(0.02)  # ... and to its plane: along the skin the prediction may be half a limb off


def cut_contacts(surface: Surface, expected: ExpectedSkin) -> Surface:
    """The surface without the edges that a contact made; its ``skin`` is that of ``assign_skin``.

    A contact is a connected set of edges whose ends are far apart on the body; it is cut if at least half of them fold
    inwards, step, or show skin that is expected just there.
    """
    ring = _cut(surface.arrays, surface.skin, expected.arrays, np.float32(LEAST_STEP))
    return replace(surface, ring=ring)


@njit(cache=True)
def _cut(mesh: MeshArrays, skin: np.ndarray, expected: SkinArrays, least_step: np.float32) -> np.ndarray:
    """The ring without the edges of contacts; skin (n,) int32 of ``Surface``."""
    points, normals, ring = mesh.points_m, mesh.normals, mesh.ring
    count = len(points)
    seam = np.arange(count).astype(np.int32)  # union-find forest: the nodes of one contact
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


@njit(cache=True)
def _near_skin(points: np.ndarray, node: Any, skin: SkinArrays, under: int) -> bool:
    """Whether a node lies at the skin point that it shows."""
    squared, along = np.float32(0.0), np.float32(0.0)
    for axis in range(3):
        gap = points[node, axis] - skin.points_m[under, axis]
        squared += gap * gap
        along += gap * skin.normals[under, axis]
    return bool(squared < SHOWN_NEAR_M * SHOWN_NEAR_M and abs(along) < SHOWN_OFF_M)


@njit(cache=True)
def _steps(points: np.ndarray, normals: np.ndarray, p: int, q: int, least_step: np.float32) -> bool:
    """Whether an edge leaves the skin of either end steeply."""
    apart2, from_p, from_q = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for axis in range(3):
        gap = points[q, axis] - points[p, axis]
        apart2 += gap * gap
        from_p += gap * normals[p, axis]
        from_q += gap * normals[q, axis]
    return bool(max(abs(from_p), abs(from_q)) > least_step * np.sqrt(apart2))
