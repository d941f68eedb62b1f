"""Depth of the surface around a node, seen from above its tangent plane, and which way up that picture is."""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.research.features.circle import FULL_TURN, peak_fraction, spread_over_two, turn_fraction

DIRECTIONS = 36  # bins of the histogram of gradients, as in SIFT
SMALLEST_M2 = 1e-12  # twice the area of a triangle that still has a slope
HALF_SPREAD = 0.5  # sigma of the weights for the angle, as a part of the window's half width


@njit(cache=True, error_model="numpy")
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
    local: np.ndarray, vertices: int, triangles: np.ndarray, count: int, angle: float, pixel: float, floor: float,
    picture: np.ndarray,
) -> None:  # fmt: skip
    """Fills picture (side, side) with heights, linear on each triangle, the highest where several lie, else the floor.

    The columns' direction is at the angle, pixels are so many metres apart, and the node is in the middle. What lies
    below the floor is not seen; with a floor of NaN everything is. Turns local, of which vertices are used, into
    columns, rows and heights.
    """
    picture[:] = floor
    middle, cosine, sine = 0.5 * (len(picture) - 1), np.cos(angle) / pixel, np.sin(angle) / pixel
    for v in range(vertices):
        x, y = local[v, 0], local[v, 1]
        local[v, 0], local[v, 1] = middle + cosine * x + sine * y, middle + cosine * y - sine * x
    for t in range(count):
        _draw_triangle(local, triangles[t, 0], triangles[t, 1], triangles[t, 2], picture)


@njit(cache=True, error_model="numpy")
def _draw_triangle(corner: np.ndarray, a: int, b: int, c: int, picture: np.ndarray) -> None:
    """Column, row and height of three corners; a pixel on a side belongs to both triangles, that none is missed."""
    last, slack = len(picture) - 1, 1e-9
    ax, ay, az = corner[a, 0], corner[a, 1], corner[a, 2]
    bx, by, cx, cy = corner[b, 0] - ax, corner[b, 1] - ay, corner[c, 0] - ax, corner[c, 1] - ay
    left, right = ax + _lowest(bx, cx), ax - _lowest(-bx, -cx)
    top, bottom = ay + _lowest(by, cy), ay - _lowest(-by, -cy)
    if not (right >= 0.0 and left <= last and bottom >= 0.0 and top <= last):
        return
    inverse = 1.0 / (bx * cy - by * cx)
    if not np.isfinite(inverse):
        return
    bz, cz = corner[b, 2] - az, corner[c, 2] - az
    bx, by, cx, cy = bx * inverse, by * inverse, cx * inverse, cy * inverse
    first_column = int(left - slack) + 1 if left > slack else 0
    last_column = int(right + slack) if right < last else last
    for i in range(int(top - slack) + 1 if top > slack else 0, (int(bottom + slack) if bottom < last else last) + 1):
        dy = i - ay
        for j in range(first_column, last_column + 1):
            dx = j - ax
            beta, gamma = dx * cy - dy * cx, bx * dy - by * dx
            if (beta >= -slack) & (gamma >= -slack) & (beta + gamma <= 1.0 + slack):
                height = az + beta * bz + gamma * cz
                if not picture[i, j] >= height:  # NaN is not
                    picture[i, j] = height


@njit(cache=True)
def _lowest(one: float, other: float) -> float:
    """Of 0 and both."""
    low = one if one < other else other
    return low if low < 0.0 else 0.0
