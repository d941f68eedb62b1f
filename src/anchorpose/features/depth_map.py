"""Depth of the surface around a node, seen from above its tangent plane, and which way up that picture is."""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.features.circle import FULL_TURN, peak_fraction, spread_over_two, turn_fraction

DIRECTIONS = 36  # bins of the histogram of gradients, as in SIFT
SMALLEST_M2 = 1e-12  # twice the area of a triangle that still has a slope
HALF_SPREAD = 0.5  # sigma of the weights for the angle, as a part of the window's half width


@njit(cache=True)
def triangle_slopes(local: np.ndarray, triangles: np.ndarray, count: int, half: float, slopes: np.ndarray) -> None:
    """Fills slopes (>= count, 5): weight, centre x and y, gradient of the height of each triangle.

    local (m, 3): tangential x, y and height of vertices; triangles (>= count, 3) of them; half: the window's half
    width. The weight is the projected area times a Gaussian of the distance, 0 where seen from below or edge on.
    """
    narrow = -0.5 / (HALF_SPREAD * half) ** 2
    for t in range(count):
        a, b, c = triangles[t]
        bx, by, bz = local[b, 0] - local[a, 0], local[b, 1] - local[a, 1], local[b, 2] - local[a, 2]
        cx, cy, cz = local[c, 0] - local[a, 0], local[c, 1] - local[a, 1], local[c, 2] - local[a, 2]
        twice = bx * cy - by * cx
        slopes[t] = 0.0
        if twice > SMALLEST_M2:
            x, y = local[a, 0] + (bx + cx) / 3.0, local[a, 1] + (by + cy) / 3.0
            slopes[t, 0], slopes[t, 1], slopes[t, 2] = twice * np.exp(narrow * (x * x + y * y)), x, y
            slopes[t, 3], slopes[t, 4] = (bz * cy - cz * by) / twice, (cz * bx - bz * cx) / twice


@njit(cache=True)
def principal_angle(slopes: np.ndarray, count: int, column: int) -> float:
    """Part of a turn to the longer principal axis of the centres (column 1) or of the gradients (column 3), to the end
    of it towards which the surface rises; NaN where there is no surface."""
    xx, xy, yy, rise_x, rise_y, total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for t in range(count):
        weight, x, y = slopes[t, 0], slopes[t, column], slopes[t, column + 1]
        xx, xy, yy = xx + weight * x * x, xy + weight * x * y, yy + weight * y * y
        rise_x, rise_y, total = rise_x + weight * slopes[t, 3], rise_y + weight * slopes[t, 4], total + weight
    if not total > 0.0:
        return np.nan
    turn = 0.5 * turn_fraction(xx - yy, 2.0 * xy, 0.0)
    along = rise_x * np.cos(turn * FULL_TURN) + rise_y * np.sin(turn * FULL_TURN)
    return turn + 0.5 if along < 0.0 else turn


@njit(cache=True)
def gradient_angle(slopes: np.ndarray, count: int, begin: float, polar: np.ndarray) -> float:
    """Part of a turn to where most of the gradient points; NaN where there is none. Bins polar (DIRECTIONS,) are
    counted from begin, which turns with the body."""
    polar[:] = 0.0
    for t in range(count):
        gx, gy = slopes[t, 3], slopes[t, 4]
        if gx != 0.0 or gy != 0.0:
            spread_over_two(polar, turn_fraction(gx, gy, begin), slopes[t, 0] * np.sqrt(gx * gx + gy * gy))
    return begin + peak_fraction(polar) if polar.max() > 0.0 else np.nan


@njit(cache=True)
def draw(
    local: np.ndarray, triangles: np.ndarray, count: int, angle: float, pixel: float, floor: float, picture: np.ndarray
) -> None:
    """Fills picture (side, side) with heights, linear on each triangle, the highest where several lie, else the floor.

    The columns' direction is at the angle, pixels are so many metres apart, and the node is in the middle. What lies
    below the floor is drawn at its height; with a floor of NaN nothing does.
    """
    picture[:] = floor
    side = len(picture)
    middle, cosine, sine = 0.5 * (side - 1), np.cos(angle) / pixel, np.sin(angle) / pixel
    corner = np.empty((3, 3))
    for t in range(count):
        for k in range(3):
            x, y = local[triangles[t, k], 0], local[triangles[t, k], 1]
            corner[k, 0], corner[k, 1] = middle + cosine * x + sine * y, middle + cosine * y - sine * x
            corner[k, 2] = local[triangles[t, k], 2]
        _draw_triangle(corner, picture)


@njit(cache=True)
def _draw_triangle(corner: np.ndarray, picture: np.ndarray) -> None:
    """Column, row and height of three corners; a pixel on a side belongs to both triangles, that none is missed."""
    ax, ay, az = corner[0]
    bx, by, bz = corner[1]
    cx, cy, cz = corner[2]
    twice = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if twice == 0.0 or not np.isfinite(twice):
        return
    side = len(picture)
    left, right = max(int(np.ceil(min(ax, bx, cx) - 1e-9)), 0), min(int(np.floor(max(ax, bx, cx) + 1e-9)), side - 1)
    top, bottom = max(int(np.ceil(min(ay, by, cy) - 1e-9)), 0), min(int(np.floor(max(ay, by, cy) + 1e-9)), side - 1)
    for i in range(top, bottom + 1):
        for j in range(left, right + 1):
            beta = ((j - ax) * (cy - ay) - (i - ay) * (cx - ax)) / twice
            gamma = ((bx - ax) * (i - ay) - (by - ay) * (j - ax)) / twice
            if beta < -1e-9 or gamma < -1e-9 or beta + gamma > 1.0 + 1e-9:
                continue
            height = az + beta * (bz - az) + gamma * (cz - az)
            if not picture[i, j] >= height:  # NaN is not
                picture[i, j] = height
