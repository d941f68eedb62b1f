"""The centre of the surface and its geodesic extrema (paper, Section IV-B, after Definition 2)."""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.errors import DegenerateGeometry
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
