"""Surface normals by weighted least squares (paper, Section III)."""

from __future__ import annotations

import numpy as np
from numba import njit


def estimate_normals(
    depth_m: np.ndarray, rays: np.ndarray, pixel: np.ndarray, radius_px: int, slope: float, spread: float
) -> np.ndarray:
    """Unit normals in the camera frame, towards the camera; NaN where fewer than three neighbours fix a plane.

    depth_m (height, width) float32 metres, 0 = no reading; rays (height, width, 2) float32 of ``Camera.pixel_rays``;
    pixel (n, 2) int16 row and column. slope, spread: the jump limit a pixel of ``jump_coefficients``. Returns (n, 3)
    float32. A plane has an inverse depth linear in the rays, so the fit is exact on planes however slanted, and with a
    noise that grows with z**2 every pixel has the same variance in it.
    """
    return _plane_normals(depth_m, rays, pixel.astype(np.int32), radius_px, np.float64(slope), np.float64(spread))


@njit(cache=True)
def _plane_normals(
    depth: np.ndarray, rays: np.ndarray, pixel: np.ndarray, radius: int, slope: float, spread: float
) -> np.ndarray:
    height, width = depth.shape
    normals = np.empty((len(pixel), 3), np.float32)
    for node in range(len(pixel)):
        row, col = pixel[node, 0], pixel[node, 1]
        z = np.float64(depth[row, col])
        limit = slope * z + spread * z * z
        u0, v0 = np.float64(rays[row, col, 0]), np.float64(rays[row, col, 1])
        s, su, sv, suu, suv, svv, sw, suw, svw = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(max(0, row - radius), min(height, row + radius + 1)):
            for j in range(max(0, col - radius), min(width, col + radius + 1)):
                neighbour = np.float64(depth[i, j])
                apart = max(abs(i - row), abs(j - col))
                if neighbour <= 0.0 or abs(neighbour - z) > limit * max(1, apart):
                    continue
                u, v, w = rays[i, j, 0] - u0, rays[i, j, 1] - v0, 1.0 / neighbour
                weight = 1.0 - ((i - row) ** 2 + (j - col) ** 2) / (2.0 * (radius + 1) ** 2)
                s += weight
                su += weight * u
                sv += weight * v
                suu += weight * u * u
                suv += weight * u * v
                svv += weight * v * v
                sw += weight * w
                suw += weight * u * w
                svw += weight * v * w
        cuu, cuv, cvv = suu - su * su / s, suv - su * sv / s, svv - sv * sv / s
        cuw, cvw = suw - su * sw / s, svw - sv * sw / s
        determinant = cuu * cvv - cuv * cuv
        if determinant <= 1e-6 * (cuu + cvv) ** 2 or determinant <= 0.0:
            normals[node] = np.nan  # one pixel, or a line of them
            continue
        a = (cuw * cvv - cvw * cuv) / determinant
        b = (cvw * cuu - cuw * cuv) / determinant
        c = (sw - a * su - b * sv) / s - a * u0 - b * v0  # plane a u + b v + c = 1 / z in the camera's own rays
        length = np.sqrt(a * a + b * b + c * c)
        normals[node, 0], normals[node, 1], normals[node, 2] = -a / length, -b / length, -c / length
    return normals
