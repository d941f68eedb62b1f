"""Curvature of the surface from how its normals turn.

Second differences of depth are mostly noise; the normals are already fitted to many pixels, and one more fit over all
neighbours within a few centimetres leaves what a limb or a nose bends. On planes, spheres and cylinders it is exact.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.features.rings import rings_within
from anchorpose.features.tangent import tangent_frame
from anchorpose.surface.surface import Surface

FLAT_RATIO = 1e-3
"""Neighbours spread less than this part of their length across it are on a line: they do not tell how normals turn."""


def principal_curvatures(surface: Surface, radius_m: float) -> np.ndarray:
    """(n, 2) float32, 1/m: the larger and the smaller curvature, positive where the skin bulges towards the camera.

    radius_m: how far along the edges the neighbours are that are used, with weights that fall to zero there. NaN where
    the neighbours do not determine it: isolated nodes, nodes on a line, normals or positions that are NaN.
    The shape operator S is the symmetric map with dn = S dx in the tangent plane, by least squares over neighbours;
    the estimate from differences of normals goes back to Taubin 1995 (doi:10.1109/ICCV.1995.466840).
    """
    rings = rings_within(surface, radius_m)
    return _curvatures(surface.points_m, surface.normals, rings.start, rings.node, rings.distance_m, radius_m)


def mean_curvature(surface: Surface, radius_m: float) -> np.ndarray:
    """(n,) float32, 1/m: half the sum of both ``principal_curvatures``."""
    return principal_curvatures(surface, radius_m).mean(axis=1)


def gaussian_curvature(surface: Surface, radius_m: float) -> np.ndarray:
    """(n,) float32, 1/m^2: the product of both ``principal_curvatures``."""
    return principal_curvatures(surface, radius_m).prod(axis=1)


@njit(cache=True)
def _curvatures(
    points: np.ndarray, normals: np.ndarray, start: np.ndarray, ring: np.ndarray, distance: np.ndarray, radius: float
) -> np.ndarray:
    """Normal equations of S = [[a, b], [b, c]]: each neighbour gives dn_u = a u + b v and dn_v = b u + c v."""
    curvatures = np.full((len(points), 2), np.nan, np.float32)
    frame, d = np.empty((3, 3)), np.empty(4)
    for node in range(len(points)):
        if not tangent_frame(normals[node], frame):
            continue
        uu, uv, vv, ru, rv, rb = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for spot in range(start[node], start[node + 1]):
            other = ring[spot]
            if other == node or not np.isfinite(normals[other, 0]):
                continue
            weight = 1.0 - (distance[spot] / radius) ** 2
            for t in range(2):
                d[t], d[2 + t] = 0.0, 0.0
                for axis in range(3):
                    d[t] += frame[t, axis] * (np.float64(points[other, axis]) - np.float64(points[node, axis]))
                    d[2 + t] += frame[t, axis] * np.float64(normals[other, axis])
            uu, uv, vv = uu + weight * d[0] * d[0], uv + weight * d[0] * d[1], vv + weight * d[1] * d[1]
            ru, rv = ru + weight * d[0] * d[2], rv + weight * d[1] * d[3]
            rb += weight * (d[1] * d[2] + d[0] * d[3])
        both, flat = uu + vv, uu * vv - uv * uv
        if not flat > (FLAT_RATIO * both) ** 2:
            continue
        # unknowns a, b, c: [uu uv 0; uv both uv; 0 uv vv] [a b c] = [ru rb rv]
        b = (rb - uv * ru / uu - uv * rv / vv) / (both - uv * uv / uu - uv * uv / vv)
        a, c = (ru - uv * b) / uu, (rv - uv * b) / vv
        middle, apart = 0.5 * (a + c), np.sqrt(0.25 * (a - c) ** 2 + b * b)
        curvatures[node, 0], curvatures[node, 1] = middle + apart, middle - apart
    return curvatures
