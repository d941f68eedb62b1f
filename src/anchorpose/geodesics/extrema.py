"""The centre of the surface and its geodesic extrema (paper, Section IV-B, after Definition 2).

The extremal cap: what the surface is around a geodesic extremum, and whether the limb really ends there.

The extremum itself is one node, the farthest of many that are almost as far; its cap's centre is steadier.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit

from anchorpose.errors import DegenerateGeometry
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.geodesics.fast_marching import band_of, fresh_state, start_at
from anchorpose.geodesics.front import march_on
from anchorpose.surface.surface import Surface


def surface_center(surface: Surface) -> int:
    """V_c: the node closest to the average position of all seen nodes.

    A hole at the centre leaves the nearest node of its rim. Raises DegenerateGeometry on a surface without seen nodes.
    """
    if surface.seen_count == 0:
        raise DegenerateGeometry("a surface without seen nodes has no centre")
    return int(_nearest(surface.points_m, surface.seen_count, seen_mean(surface)))


def seen_mean(surface: Surface) -> np.ndarray:
    """(3,) float64: the average position of all seen nodes, NaN without any."""
    return _mean(surface.points_m, surface.seen_count)


def geodesic_extrema(surface: Surface, field: np.ndarray, radius_m: float) -> np.ndarray:
    """Seen nodes farther from the centre than every other seen one within ``radius_m`` of them, the farthest first.

    field (n,) float32: geodesic distance from the centre; inf (unreachable) nodes are never extrema. radius_m: r of
    the paper, geodesic, over hidden skin as well. Returns (k,) int32. The rule is exact: nodes that no direct neighbour
    exceeds are marched from until a node as far from the centre turns up.
    """
    if field.shape != (len(surface),):
        raise ValueError(f"field is {field.shape}, the surface has {len(surface)} nodes")
    if not radius_m > 0:
        raise ValueError(f"radius_m must be positive, got {radius_m}")
    field = field.astype(np.float32)
    field[surface.seen_count :] = -np.inf
    links = (surface.ring, surface.link_start, surface.link_node)
    candidates = _one_ring_maxima(field, *links)
    points = np.ascontiguousarray(surface.points_m, dtype=np.float32)
    stands = _is_extremum(
        points, *links, surface.link_length_m, field, candidates, float(radius_m), band_of(points, surface.ring)
    )
    extrema = candidates[stands]
    return extrema[np.argsort(-field[extrema], kind="stable")]


@njit(cache=True, error_model="numpy")
def _mean(points: np.ndarray, count: int) -> np.ndarray:
    """(3,) float64 of the first count points (n, 3), summed in double precision without a copy of them."""
    total = np.zeros(3)
    for k in range(count):
        for axis in range(3):
            total[axis] += points[k, axis]
    return total / np.float64(count)


@njit(cache=True)
def _nearest(points: np.ndarray, count: int, place: np.ndarray) -> int:
    found, least = -1, np.inf
    for k in range(count):
        apart2 = 0.0
        for axis in range(3):
            apart2 += (points[k, axis] - place[axis]) ** 2
        if apart2 < least:
            found, least = k, apart2
    return found


@njit(cache=True)
def _one_ring_maxima(field: np.ndarray, ring: np.ndarray, link_start: np.ndarray, link_node: np.ndarray) -> np.ndarray:
    maxima = np.empty(len(field), np.int32)
    count = 0
    for node in range(len(field)):
        highest = np.isfinite(field[node])
        for k in range(8):
            if highest and ring[node, k] >= 0:
                highest = field[ring[node, k]] < field[node]
        for k in range(link_start[node], link_start[node + 1]):
            if highest:
                highest = field[link_node[k]] < field[node]
        if highest:
            maxima[count] = node
            count += 1
    return maxima[:count].copy()


@njit(cache=True)
def _is_extremum(
    points: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    link_length: np.ndarray,
    field: np.ndarray,
    candidates: np.ndarray,
    radius: float,
    band: float,
) -> np.ndarray:
    """Fast marching from each candidate that ends at the first node as far from the centre."""
    stands = np.empty(len(candidates), np.bool_)
    fans, state, work = fresh_state(len(points))
    for k in range(len(candidates)):
        start_at(state, candidates[k : k + 1])
        level = field[candidates[k]]
        met = march_on(points, ring, link_start, link_node, link_length, fans, state, work, radius, band, field, level)
        stands[k] = not met
    return stands


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
