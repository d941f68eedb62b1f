"""The gradient of a function that is known at the nodes."""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.features.curvature import FLAT_RATIO
from anchorpose.features.tangent import tangent_frame
from anchorpose.surface.surface import Surface


def mesh_gradient(surface: Surface, values: np.ndarray) -> np.ndarray:
    """(n, 3) float32, units of values per metre, world frame: the gradient in each node's tangent plane.

    values (n,): the function. NaN where it is not known, where the normal is not, and where fewer than two neighbours
    in different directions know it. Least squares over the directional derivatives along the grid's edges: exact for
    functions that are linear on a plane. Raises ValueError where values are not one a node.
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
