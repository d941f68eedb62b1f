"""Farthest-point samples of a surface by geodesic distance."""

from __future__ import annotations

import numpy as np

from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.surface.surface import Surface

APART_M = 1e3
"""Stands for the distance between pieces of surface: the same on every mesh, and no distance on a body is near it."""


def farthest_points(surface: Surface, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of which each is as far as possible from those before it, and their distances to all nodes.

    Returns nodes (k,) int32, k = ``count`` unless there are fewer, and fields (k, n) float32 metres, ``APART_M`` on
    other pieces. The first is the node farthest from the middle of its piece, the middle being the node nearest the
    mean; a piece without samples is farther than any node on one with some. Raises ValueError on nodes not finite.
    Source: Gonzalez 1985 (doi:10.1016/0304-3975(85)90224-5): at most twice as coarse as the best choice.
    """
    wanted = min(count, len(surface))
    nodes, fields = np.empty(wanted, np.int32), np.empty((wanted, len(surface)), np.float32)
    if wanted == 0:
        return nodes, fields
    away = surface.points_m - surface.points_m.mean(axis=0, dtype=np.float64)
    nearest = field_from(surface, int((away**2).sum(axis=1).argmin()))
    nodes[0] = np.where(nearest < APART_M, nearest, -1.0).argmax()
    nearest = fields[0] = field_from(surface, nodes[0])
    for row in range(1, wanted):
        nodes[row] = nearest.argmax()
        fields[row] = field_from(surface, nodes[row])
        nearest = np.minimum(nearest, fields[row])
        nearest[nodes[: row + 1]] = -1.0  # chosen once, even where several nodes are in one place
    return nodes, fields


def field_from(surface: Surface, node: int) -> np.ndarray:
    """(n,) float32 distance field of one node."""
    field = geodesic_distance(surface, np.array([node]))[0]
    return np.minimum(field, np.float32(APART_M))
