"""Surface normals by weighted least squares (paper, Section III)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from anchorpose.surface.denoise import extent

TILE = 256  # pixels of a row at once; the sums of a tile, at fixed places in one array, stay in the nearest cache
S, SU, SV, SUU, SUV, SVV, SW, SUW, SVW, LIMIT, NX, NY, NZ = (np.uint64(TILE * place) for place in range(13))


def estimate_normals(
    depth_m: np.ndarray, rays: np.ndarray, pixel: np.ndarray, radius_px: int, slope: float, spread: float
) -> np.ndarray:
    """Unit normals in the camera frame, towards the camera; NaN where fewer than three neighbours fix a plane.

    depth_m (height, width) float32 metres, 0 = no reading; rays (height, width, 2) float32 of ``Camera.pixel_rays``;
    pixel (n, 2) int16 row and column, each with a reading, fastest in raster order. slope, spread: the jump limit per
    pixel of ``jump_coefficients``. Returns (n, 3) float32. Raises ValueError on a pixel without a reading. A plane
    has an inverse depth linear in the rays, so the fit is exact on planes however slanted, and with a noise that grows
    with z**2 every pixel has the same variance in it.
    """
    depth = np.ascontiguousarray(depth_m, dtype=np.float32)
    if not (depth[pixel[:, 0], pixel[:, 1]] > 0).all():
        raise ValueError("a normal was asked for where there is no reading")
    window, top, left = _window(depth, rays, radius_px)
    pixel = np.ascontiguousarray(pixel, dtype=np.int16)
    return _plane_normals(window, pixel, top, left, radius_px, np.float32(slope), np.float32(spread))


class Window(NamedTuple):
    """The part of the depth frame that holds every reading, with a margin, so that no neighbour needs a test.

    z, inverse (rows, cols) float32: depth and its inverse, both 0 without a reading; u, v (rows, cols) float32: rays.
    """

    z: np.ndarray
    inverse: np.ndarray
    u: np.ndarray
    v: np.ndarray


def _window(depth: np.ndarray, rays: np.ndarray, margin: int) -> tuple[Window, int, int]:
    """The window, and the row and column of the depth frame where it begins behind its margin."""
    top, bottom, left, right = extent(depth > 0)
    shape = bottom - top + 2 * margin, right - left + 2 * margin + 1
    window = Window(*(np.zeros(shape, np.float32) for _ in range(4)))
    inside = np.s_[margin : margin + bottom - top, margin : margin + right - left]
    reading, ray = depth[top:bottom, left:right], rays[top:bottom, left:right]
    window.z[inside], window.u[inside], window.v[inside] = reading, ray[:, :, 0], ray[:, :, 1]
    np.divide(np.float32(1.0), reading, out=window.inverse[inside], where=reading > 0)
    return window, top, left


@njit(cache=True, nogil=True)
def _plane_normals(
    window: Window, pixel: np.ndarray, top: int, left: int, radius: int, slope: Any, spread: Any
) -> np.ndarray:
    """Tile by tile: the sums of the neighbours of each pixel, and the planes that solve them."""
    z = window.z
    normals = np.empty((len(pixel), 3), np.float32)
    sums = np.empty(13 * TILE, np.float32)
    node = 0
    while node < len(pixel):
        row, first, end = pixel[node, 0], np.int64(pixel[node, 1]), node
        last = first
        while end < len(pixel) and pixel[end, 0] == row and first <= pixel[end, 1] < first + TILE:
            last = max(last, np.int64(pixel[end, 1]))
            end += 1
        own, at = np.uint64(row - top + radius), np.uint64(first - left + radius)
        count = np.uint64(last + 1 - first)
        for k in range(np.uint64(9 * TILE)):
            sums[k] = 0.0
        for k in range(count):
            sums[LIMIT + k] = slope * z[own, at + k] + spread * z[own, at + k] * z[own, at + k]
        for i in range(-radius, radius + 1):
            for j in range(-radius, radius + 1, 2):
                apart, further = max(1, abs(i), abs(j)), max(1, abs(i), abs(j + 1))
                near, nearer = _tap_weight(i, j, radius), _tap_weight(i, j + 1, radius)
                tap = np.uint64(np.int64(own) + i), np.uint64(np.int64(at) + j)
                _add_taps(window, sums, (own, at), tap, count, np.float32(apart), np.float32(further), near, nearer)
        _solve(window, sums, own, at, count)
        for k in range(node, end):
            spot = np.uint64(pixel[k, 1] - first)
            normals[k, 0], normals[k, 1], normals[k, 2] = sums[NX + spot], sums[NY + spot], sums[NZ + spot]
        node = end
    return normals


@njit(cache=True, nogil=True)
def _tap_weight(i: int, j: int, radius: int) -> Any:
    """Weight of a neighbour i rows and j columns away; 0 beyond the window, whose odd rows are taken two by two."""
    return np.float32(1.0 - (i**2 + j**2) / (2.0 * (radius + 1) ** 2)) if j <= radius else np.float32(0.0)


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _add_taps(
    window: Window,
    sums: np.ndarray,
    own_place: Any,
    tap_place: Any,
    count: Any,
    apart_a: Any,
    apart_b: Any,
    weight_a: Any,
    weight_b: Any,
) -> None:
    """Two neighbours of each pixel, about that pixel's own ray and inverse depth, which keeps float32 exact.

    own_place, tap_place: row and column of the tile's first pixel, and of its first neighbour a; b is one to the right.
    """
    z, inverse, u, v = window
    row, at = own_place
    i, there = tap_place
    for k in range(count):
        a, b = there + k, there + k + np.uint64(1)
        limit, own, w = sums[LIMIT + k], z[row, at + k], inverse[row, at + k]
        own_u, own_v = u[row, at + k], v[row, at + k]
        seen_a = (abs(z[i, a] - own) <= limit * apart_a) & (inverse[i, a] > np.float32(0.0))
        seen_b = (abs(z[i, b] - own) <= limit * apart_b) & (inverse[i, b] > np.float32(0.0))
        wa, wb = weight_a if seen_a else np.float32(0.0), weight_b if seen_b else np.float32(0.0)
        ua, va, ia = u[i, a] - own_u, v[i, a] - own_v, inverse[i, a] - w
        ub, vb, ib = u[i, b] - own_u, v[i, b] - own_v, inverse[i, b] - w
        wua, wva, wub, wvb = wa * ua, wa * va, wb * ub, wb * vb
        sums[S + k] += wa + wb
        sums[SU + k] += wua + wub
        sums[SV + k] += wva + wvb
        sums[SUU + k] += wua * ua + wub * ub
        sums[SUV + k] += wua * va + wub * vb
        sums[SVV + k] += wva * va + wvb * vb
        sums[SW + k] += wa * ia + wb * ib
        sums[SUW + k] += wua * ia + wub * ib
        sums[SVW + k] += wva * ia + wvb * ib


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(window: Window, sums: np.ndarray, row: Any, at: Any, count: Any) -> None:
    """Plane a u + b v + c = 1 / z in the camera's own rays; NaN where the pixels seen are one, or a line of them."""
    _, inverse, u, v = window
    for k in range(count):
        s, su, sv = np.float64(sums[S + k]), np.float64(sums[SU + k]), np.float64(sums[SV + k])
        cuu, cuv, cvv = sums[SUU + k] - su * su / s, sums[SUV + k] - su * sv / s, sums[SVV + k] - sv * sv / s
        cuw, cvw = sums[SUW + k] - su * sums[SW + k] / s, sums[SVW + k] - sv * sums[SW + k] / s
        determinant = cuu * cvv - cuv * cuv
        a = (cuw * cvv - cvw * cuv) / determinant
        b = (cvw * cuu - cuw * cuv) / determinant
        c = inverse[row, at + k] + (sums[SW + k] - a * su - b * sv) / s
        c -= a * u[row, at + k] + b * v[row, at + k]
        fixed = (determinant > 1e-6 * (cuu + cvv) ** 2) & (determinant > 0.0)
        length = -np.sqrt(a * a + b * b + c * c) if fixed else np.nan
        sums[NX + k], sums[NY + k], sums[NZ + k] = a / length, b / length, c / length
