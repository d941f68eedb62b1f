"""Compute derivatives on the mesh: the gradient of a function known at the nodes, and the curvature of the surface.

Curvature is computed from the change of the normals, since second differences of depth are mostly noise. The normals
are already fitted to many pixels. Fitting the change of the normals over all neighbours within a few centimetres
preserves the curvature of a limb or a nose. On planes, spheres and cylinders, the result is exact.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.research.features.rings import rings_within
from anchorpose.surface.surface import Surface


@njit(cache=True)
def tangent_frame(normal: np.ndarray, frame: np.ndarray) -> bool:
    """Fill frame (3, 3) float64 with two unit tangents and the unit normal, right-handed; False for a NaN or 0 normal.

    The choice of the tangents depends on the world's axes, so a caller's result must not depend on this choice.
    """
    x, y, z = np.float64(normal[0]), np.float64(normal[1]), np.float64(normal[2])
    size = np.sqrt(x * x + y * y + z * z)
    if not size > 0.0:
        return False
    x, y, z = x / size, y / size, z / size
    frame[2, 0], frame[2, 1], frame[2, 2] = x, y, z
    if abs(x) < abs(y) and abs(x) < abs(z):
        across = np.sqrt(y * y + z * z)
        frame[0, 0], frame[0, 1], frame[0, 2] = 0.0, -z / across, y / across
    elif abs(y) < abs(z):
        across = np.sqrt(x * x + z * z)
        frame[0, 0], frame[0, 1], frame[0, 2] = z / across, 0.0, -x / across
    else:
        across = np.sqrt(x * x + y * y)
        frame[0, 0], frame[0, 1], frame[0, 2] = -y / across, x / across, 0.0
    frame[1, 0] = y * frame[0, 2] - z * frame[0, 1]
    frame[1, 1] = z * frame[0, 0] - x * frame[0, 2]
    frame[1, 2] = x * frame[0, 1] - y * frame[0, 0]
    return True


FLAT_RATIO = 1e-3
"""Minimum ratio of the width to the length of the neighbours' spread. Below this ratio, the neighbours lie nearly on a
line, and the derivative is NaN.
"""


def principal_curvatures(surface: Surface, radius_m: float) -> np.ndarray:
    """Return (n, 2) float32, 1/m: the larger and the smaller curvature of each node.

    Curvature is positive where the skin bulges towards the camera. radius_m: distance along the edges up to which
    neighbours are used; their weights fall to zero at this distance. Curvatures are NaN if neighbours do not determine
    them: at isolated nodes, at nodes on a line, and where normals or positions are NaN. The shape operator S is the
    symmetric map from steps dx in the tangent plane to changes of the normal, dn = S dx, fitted to the neighbours by
    least squares. The estimate from differences of normals goes back to Taubin 1995 (doi:10.1109/ICCV.1995.466840).
    """
    rings = rings_within(surface, radius_m)
    return _curvatures(surface.points_m, surface.normals, rings.start, rings.node, rings.distance_m, radius_m)


def mean_curvature(surface: Surface, radius_m: float) -> np.ndarray:
    """Return (n,) float32, 1/m: half the sum of both ``principal_curvatures``."""
    return principal_curvatures(surface, radius_m).mean(axis=1)


def gaussian_curvature(surface: Surface, radius_m: float) -> np.ndarray:
    """Return (n,) float32, 1/m^2: the product of both ``principal_curvatures``."""
    return principal_curvatures(surface, radius_m).prod(axis=1)


@njit(cache=True)
def _curvatures(
    points: np.ndarray, normals: np.ndarray, start: np.ndarray, ring: np.ndarray, distance: np.ndarray, radius: float
) -> np.ndarray:
    """Return the curvatures, which are the eigenvalues of the shape operator S = [[a, b], [b, c]]; S is fitted by the
    normal equations of least squares.

    A neighbour at (u, v) in the tangent plane, whose normal differs by (dn_u, dn_v), gives two equations: dn_u = a u +
    b v and dn_v = b u + c v.
    """
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
        # the normal equations for a, b and c, in which uu, uv, vv, ru, rb and rv are weighted sums over the neighbours,
        # and both = uu + vv: [uu uv 0; uv both uv; 0 uv vv] [a b c] = [ru rb rv]
        b = (rb - uv * ru / uu - uv * rv / vv) / (both - uv * uv / uu - uv * uv / vv)
        a, c = (ru - uv * b) / uu, (rv - uv * b) / vv
        middle, apart = 0.5 * (a + c), np.sqrt(0.25 * (a - c) ** 2 + b * b)
        curvatures[node, 0], curvatures[node, 1] = middle + apart, middle - apart
    return curvatures


def mesh_gradient(surface: Surface, values: np.ndarray) -> np.ndarray:
    """Return (n, 3) float32, units of values per metre, world frame: the gradient in each node's tangent plane.

    values (n,): the function. The gradient is NaN if the function or the normal is unknown, or if fewer than two
    neighbours in different directions have a value. The gradient follows by least squares from the directional
    derivatives along the grid's edges, so it is exact for functions that are linear on a plane. Raises ValueError if
    the number of values is not the number of nodes.
    """
    values = np.asarray(values, np.float64)
    if values.shape != (len(surface),):
        raise ValueError(f"a surface of {len(surface)} nodes has one value each, got {values.shape}")
    return _gradients(surface.points_m, surface.normals, surface.ring, values)


@njit(cache=True)
def _gradients(points: np.ndarray, normals: np.ndarray, ring: np.ndarray, values: np.ndarray) -> np.ndarray:
    gradient = np.full((len(points), 3), np.nan, np.float32)
    frame = np.empty((3, 3))
    for node in range(len(points)):
        if not (np.isfinite(values[node]) and tangent_frame(normals[node], frame)):
            continue
        uu, uv, vv, ru, rv = 0.0, 0.0, 0.0, 0.0, 0.0
        for place in range(8):
            other = ring[node, place]
            if other < 0 or not np.isfinite(values[other]):
                continue
            u, v, length2 = 0.0, 0.0, 0.0
            for axis in range(3):
                along = np.float64(points[other, axis]) - np.float64(points[node, axis])
                u, v, length2 = u + frame[0, axis] * along, v + frame[1, axis] * along, length2 + along * along
            if not length2 > 0.0:
                continue
            rise = values[other] - values[node]
            uu, uv, vv = uu + u * u / length2, uv + u * v / length2, vv + v * v / length2
            ru, rv = ru + u * rise / length2, rv + v * rise / length2
        flat = uu * vv - uv * uv
        if not flat > (FLAT_RATIO * (uu + vv)) ** 2:
            continue
        along_u, along_v = (vv * ru - uv * rv) / flat, (uu * rv - uv * ru) / flat
        for axis in range(3):
            gradient[node, axis] = along_u * frame[0, axis] + along_v * frame[1, axis]
    return gradient
