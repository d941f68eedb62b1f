"""Exact distance from points to a triangle mesh."""

from __future__ import annotations

import numba
import numpy as np


def mesh_distance_m(points_m: np.ndarray, vertices_m: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(n,) float64 distance of each point (n, 3) to the nearest triangle; never negative: a mesh need not be closed.

    vertices_m (v, 3), faces (f, 3) indices. NaN where a point is NaN.
    Source: closest point on a triangle, Ericson, Real-Time Collision Detection (2005), Section 5.1.5. A sphere around
    each triangle skips those that cannot be nearest.
    """
    corners = np.ascontiguousarray(vertices_m[faces], dtype=np.float64)
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    points = np.ascontiguousarray(points_m, dtype=np.float64)
    return _nearest(points, corners, centres, radii)


@numba.njit(cache=True)
def _nearest(points: np.ndarray, corners: np.ndarray, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    distances = np.empty(len(points))
    for i in range(len(points)):
        best = np.inf
        for f in range(len(corners)):
            if np.sqrt(np.sum((points[i] - centres[f]) ** 2)) - radii[f] < best:
                best = min(best, _to_triangle(points[i], corners[f, 0], corners[f, 1], corners[f, 2]))
        distances[i] = best if np.isfinite(points[i].sum()) else np.nan
    return distances


@numba.njit(cache=True)
def _to_triangle(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    ab, ac, ap, bp, cp = b - a, c - a, p - a, p - b, p - c
    d1, d2 = np.sum(ab * ap), np.sum(ac * ap)
    d3, d4 = np.sum(ab * bp), np.sum(ac * bp)
    d5, d6 = np.sum(ab * cp), np.sum(ac * cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0 and d2 <= 0:
        v, w = 0.0, 0.0  # corner a
    elif d3 >= 0 and d4 <= d3:
        v, w = 1.0, 0.0  # corner b
    elif d6 >= 0 and d5 <= d6:
        v, w = 0.0, 1.0  # corner c
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        v, w = d1 / (d1 - d3), 0.0  # edge ab
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        v, w = 0.0, d2 / (d2 - d6)  # edge ac
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))  # edge bc
        v = 1.0 - w
    else:
        total = va + vb + vc
        v, w = vb / total, vc / total
    return np.sqrt(np.sum((ap - v * ab - w * ac) ** 2))
