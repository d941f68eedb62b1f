"""Where the patient touches himself the mesh is cut again: thigh on thigh, a hand on the trunk.

A depth picture joins what touches. Neighbours of the mesh that show skin far apart on the body are no neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from anchorpose.surface.skin_under import crease
from anchorpose.surface.surface import ExpectedSkin, Surface, way_over_skin


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactConfig:
    """What makes a contact: edges over a way that is too long, most of them with evidence, all of them connected."""

    least_way_m: float = 0.07  # over the body between neighbours of the mesh; less is what skin points 3 cm apart blur
    least_crease: float = (
        0.10  # 6 degrees a node; an arm that was predicted elsewhere is cut nowhere on its smooth skin
    )
    least_step: float = 0.6  # sine of the angle at which an edge leaves the skin of either end: a hand on the trunk
    sure_way_m: float = 0.25  # parts so far apart on the body are told apart without a crease ...
    sure_near_m: float = 0.06  # ... where both sides are as near as that to the skin that they show, ...
    sure_off_m: float = 0.02  # ... and to its sheet: along the skin the prediction may be off by half a limb

    def __post_init__(self) -> None:
        for name in ("least_way_m", "least_crease", "least_step", "sure_way_m", "sure_near_m", "sure_off_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


def cut_contacts(surface: Surface, expected: ExpectedSkin, config: ContactConfig | None = None) -> Surface:
    """The surface without the edges that a contact made; its ``skin`` is that of ``show_skin``.

    A contact is a connected set of edges; it is cut if at least half of them fold inwards, step, or show skin that is
    expected just there.
    """
    config = config or ContactConfig()
    ring = _cut(
        surface.points_m, surface.normals, surface.ring, surface.skin, expected.points_m, expected.normals,
        expected.map.landmarks_m, np.float32(config.least_way_m), np.float32(config.least_crease),
        np.float32(config.least_step), np.float32(config.sure_way_m), np.float32(config.sure_near_m),
        np.float32(config.sure_off_m),
    )  # fmt: skip
    return replace(surface, ring=ring)


@njit(cache=True)
def _beside(
    points: np.ndarray,
    node: int,
    skin_points: np.ndarray,
    skin_normals: np.ndarray,
    under: int,
    near: np.float32,
    off: np.float32,
) -> bool:
    squared, along = np.float32(0.0), np.float32(0.0)
    for axis in range(3):
        gap = points[node, axis] - skin_points[under, axis]
        squared += gap * gap
        along += gap * skin_normals[under, axis]
    return bool(squared < near * near and abs(along) < off)


@njit(cache=True)
def _steps(points: np.ndarray, normals: np.ndarray, p: int, q: int, least_step: np.float32) -> bool:
    apart2, from_p, from_q = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for axis in range(3):
        gap = points[q, axis] - points[p, axis]
        apart2 += gap * gap
        from_p += gap * normals[p, axis]
        from_q += gap * normals[q, axis]
    return bool(max(abs(from_p), abs(from_q)) > least_step * np.sqrt(apart2))


@njit(cache=True)
def _root(seam: np.ndarray, node: int) -> int:
    while seam[node] != node:
        seam[node] = seam[seam[node]]
        node = seam[node]
    return node


@njit(cache=True)
def _cut(
    points: np.ndarray, normals: np.ndarray, ring: np.ndarray, skin: np.ndarray, skin_points: np.ndarray,
    skin_normals: np.ndarray, landmarks: np.ndarray, least_way: np.float32, least_crease: np.float32,
    least_step: np.float32, sure_way: np.float32, sure_near: np.float32, sure_off: np.float32,
) -> np.ndarray:  # fmt: skip
    count = len(points)
    seam = np.arange(count).astype(np.int32)  # union-find: the nodes of one contact
    edge = np.empty((4 * count, 2), np.int32)
    way = np.empty(4 * count, np.float32)
    cuts = 0
    for p in range(count):
        for k in range(4):
            q = ring[p, k]
            if q < 0 or skin[p] < 0 or skin[q] < 0 or skin[p] == skin[q]:
                continue
            way[cuts] = way_over_skin(landmarks, skin[p], skin[q])
            if way[cuts] > least_way:
                edge[cuts, 0], edge[cuts, 1] = p, k
                cuts += 1
                one, other = _root(seam, p), _root(seam, q)
                seam[max(one, other)] = min(one, other)
    if cuts == 0:
        return ring
    evidence = np.zeros(count, np.int32)
    for c in range(cuts):
        p, q = edge[c, 0], ring[edge[c, 0], edge[c, 1]]
        shown = (
            way[c] > sure_way
            and _beside(points, p, skin_points, skin_normals, skin[p], sure_near, sure_off)
            and _beside(points, q, skin_points, skin_normals, skin[q], sure_near, sure_off)
        )
        folds = crease(points, normals, p, q) > least_crease or _steps(points, normals, p, q, least_step)
        evidence[_root(seam, p)] += 1 if shown or folds else -1
    ring = ring.copy()
    for c in range(cuts):
        p, k = edge[c, 0], edge[c, 1]
        if evidence[_root(seam, p)] >= 0:
            ring[ring[p, k], (k + 4) % 8] = -1
            ring[p, k] = -1
    return ring
