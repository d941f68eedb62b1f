"""The extremal cap: what the surface is around a geodesic extremum, and whether the limb really ends there.

The extremum itself is one node, the farthest of many that are almost as far; its cap's centre is steadier.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.surface.surface import Surface

FARTHEST: Final = 10  # nodes whose mean distance is the end: the single farthest is noise by half a centimetre
STUMP_SHARE: Final = 0.5  # of a cap's outer half: beside a bar all of it is cut, beside one wrong reading little
LONGER: Final = 1.5  # cap depths, 9 cm: fingers that the sensor lost are shorter, a hand from the wrist on is not
LONGER_AT_CUT: Final = 1.0  # where something stands in front of the end: a wrist behind a bar
HIDDEN_AREA: Final = 3.0  # of a seen node's: skin points are 2.2 cm apart, nodes 1.3 cm
LEAST_SIGMA_M: Final = 0.003  # a quarter of the nodes' distance: a cap of one node has no radius
SPREAD: Final = 0.20  # of a cap's radius: by how much its centre moves from frame to frame


@dataclass(frozen=True, slots=True, eq=False)
class Cap:
    """Around one extremum: what is seen of the surface within some depth of it.

    nodes (m,) int: seen nodes; center_m (3,): their mean, the outermost counting most. reach_m: how far from the centre
    of the surface the outermost lies. sigma_m: one standard deviation of the centre on an axis. stump: it ends because
    something else stands in front; goes_on: hidden skin leads much farther.
    """

    nodes: np.ndarray
    center_m: np.ndarray
    reach_m: float
    sigma_m: float
    stump: bool
    goes_on: bool


def find_caps(
    surface: Surface, field: np.ndarray, extrema: np.ndarray, depth_m: float, cut: np.ndarray | None = None
) -> list[Cap]:
    """The caps of the extrema (k,), seen nodes, in their order.

    field (n,) float32: distance from the centre; a cap holds what is at most ``depth_m`` nearer to the centre than the
    mean of its ten farthest nodes. cut (n,) bool: nodes at an edge that something else cut (``surface.border``).
    """
    if len(extrema) == 0:
        return []
    near = geodesic_distance(surface, extrema, 2.0 * depth_m)
    return [
        _cap(surface, field, near[row] < np.inf, float(field[tip]), depth_m, cut) for row, tip in enumerate(extrema)
    ]


def _cap(
    surface: Surface, field: np.ndarray, near: np.ndarray, highest: float, depth_m: float, cut: np.ndarray | None
) -> Cap:
    around = np.flatnonzero(near)
    nodes, hidden = around[around < surface.seen_count], around[around >= surface.seen_count]
    end = float(np.sort(field[nodes])[-FARTHEST:].mean())
    nodes = nodes[field[nodes] > end - depth_m]
    weight = np.minimum(field[nodes] - (end - depth_m), depth_m).astype(np.float64)
    points = surface.points_m[nodes].astype(np.float64)
    center = weight @ points / weight.sum()
    radius = float(np.sqrt(weight @ ((points - center) ** 2).sum(axis=1) / weight.sum() / 3.0))
    beyond = HIDDEN_AREA * float((field[hidden] > highest).sum())
    unseen = beyond / (beyond + len(nodes))
    stump = cut is not None and _is_stump(surface, field, nodes, cut)
    longer = (LONGER_AT_CUT if stump else LONGER) * depth_m
    return Cap(
        nodes=nodes,
        center_m=center,
        reach_m=highest,
        sigma_m=max(LEAST_SIGMA_M, float(np.hypot(SPREAD * radius, unseen * depth_m))),
        stump=stump,
        goes_on=bool((field[hidden] > highest + longer).any()),
    )


def _is_stump(surface: Surface, field: np.ndarray, nodes: np.ndarray, cut: np.ndarray) -> bool:
    """Whether most of what every camera sees of the outer half of a cap lies at a cut."""
    outer = nodes[field[nodes] >= (field[nodes].max() + field[nodes].min()) / 2.0]
    seen = np.bincount(surface.camera[outer])
    at_cut = np.bincount(surface.camera[outer], weights=cut[outer])
    return bool((at_cut[seen > 0] >= STUMP_SHARE * seen[seen > 0]).all())
