"""Farthest-point samples of a surface by geodesic distance."""

from __future__ import annotations

import numpy as np

from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.surface.surface import Surface

APART_M = 1e3
"""Stands for the distance between pieces of surface: the same on every mesh, and no distance on a body is near it."""


def farthest_points(surface: Surface, count: int, eligible: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of which each is as far as possible from those before it, and their distances to all nodes.

    eligible (n,) bool: nodes that may be chosen. Returns nodes (k,) int32, k = ``count`` unless fewer are eligible, and
    fields (k, n) float32 metres, ``APART_M`` on other pieces. The first is the farthest from the eligible node nearest
    the mean of them on its piece of surface; a piece without samples is always farther than any node on one with some.
    Source: Hochbaum and Shmoys 1985 (doi:10.1287/moor.10.2.180): at most twice as coarse as the best choice.
    """
    wanted = min(count, int(np.count_nonzero(eligible)))
    nodes, fields = np.empty(wanted, np.int32), np.empty((wanted, len(surface)), np.float32)
    if wanted == 0:
        return nodes, fields
    nearest = np.where(eligible, _from(surface, _middle(surface, eligible)), -1.0)
    nearest[nearest == APART_M] = -1.0  # of the start's piece first
    for row in range(wanted):
        nodes[row] = nearest.argmax()
        fields[row] = _from(surface, nodes[row])
        before = np.where(eligible, APART_M, -1.0) if row == 0 else nearest
        nearest = np.minimum(before, np.where(eligible, fields[row], -1.0))
        nearest[nodes[: row + 1]] = -1.0
    return nodes, fields


def _middle(surface: Surface, eligible: np.ndarray) -> int:
    candidates = np.flatnonzero(eligible)
    away = surface.points_m[candidates] - surface.points_m[candidates].mean(axis=0, dtype=np.float64)
    return int(candidates[(away**2).sum(axis=1).argmin()])


def _from(surface: Surface, node: int) -> np.ndarray:
    """(n,) float32 distance field of one node."""
    field = geodesic_distance(surface, np.array([node]))[0]
    return np.minimum(field, np.float32(APART_M))
