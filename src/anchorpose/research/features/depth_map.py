"""Draw the depth of the surface around a node as a small image, and compute the image's SIFT descriptor.

The surface is seen along the node's normal; pixel values are heights in metres above the node's tangent plane, NaN
where unknown.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from anchorpose.research.features.circle import FULL_TURN, turn_fraction

SMALLEST_M2 = 1e-12  # m², twice the minimum area of a triangle for its slope to be computed
HALF_SPREAD = 0.5  # sigma of the Gaussian in ``triangle_slopes``, as a share of half the width of four cells
CELLS: Final = 4  # number of cells on each side of the image
ORIENTATIONS: Final = 8  # number of bins, one per direction of the gradient, in a cell's histogram
WIDTH: Final = CELLS * CELLS * ORIENTATIONS
CLIP: Final = 0.2  # maximum value in a descriptor of unit length, so that a single edge does not outweigh all others


@njit(cache=True, error_model="numpy")
def triangle_slopes(local: np.ndarray, triangles: np.ndarray, count: int, half: float, slopes: np.ndarray) -> None:
    """Fill slopes (>= count, 5) with each triangle's weight, centre (x, y) and gradient of the height.

    local (m, 3): coordinates of the vertices: x and y in the node's tangent plane, and the height above this plane.
    triangles (>= count, 3): the corners of each triangle, as row numbers of ``local``. half: metres, half the width of
    the square that the image's 4 x 4 cells cover. A triangle's weight is twice its area as seen in the image, times a
    Gaussian of its centre's distance from the node; it is 0 for a triangle seen from below or edge on.
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
def outline_angle(slopes: np.ndarray, count: int) -> float:
    """Return the direction, as a share of a turn, in which the triangles' centres spread most around the node.

    Of the two opposite directions, the direction in which the surface rises is returned. The result is NaN without a
    surface.
    """
    xx, xy, yy, rise_x, rise_y, total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for t in range(count):
        weight, x, y = slopes[t, 0], slopes[t, 1], slopes[t, 2]
        xx, xy, yy = xx + weight * x * x, xy + weight * x * y, yy + weight * y * y
        rise_x, rise_y, total = rise_x + weight * slopes[t, 3], rise_y + weight * slopes[t, 4], total + weight
    if not total > 0.0:
        return np.nan
    turn = 0.5 * turn_fraction(xx - yy, 2.0 * xy, 0.0)
    along = rise_x * np.cos(turn * FULL_TURN) + rise_y * np.sin(turn * FULL_TURN)
    return turn + 0.5 if along < 0.0 else turn


@njit(cache=True)
def draw_depth_map(
    local: np.ndarray, triangles: np.ndarray, count: int, angle: float, pixel: float, floor: float, image: np.ndarray
) -> None:
    """Fill image (side, side) with the heights of the surface, and with the height ``floor`` at pixels without surface.

    Heights are linear on each triangle; where several triangles overlap, the highest counts. The column number
    increases in the direction ``angle`` (radians), pixels are ``pixel`` metres apart, and the node is in the middle.
    Surface below the floor is not drawn; if the floor is NaN, all surface is drawn. The array local (m, 3) is
    overwritten with columns, rows and heights.
    """
    image[:] = floor
    middle, cosine, sine = 0.5 * (len(image) - 1), np.cos(angle) / pixel, np.sin(angle) / pixel
    for v in range(len(local)):
        x, y = local[v, 0], local[v, 1]
        local[v, 0], local[v, 1] = middle + cosine * x + sine * y, middle + cosine * y - sine * x
    for t in range(count):
        _draw_triangle(local, triangles[t, 0], triangles[t, 1], triangles[t, 2], image)


@njit(cache=True, error_model="numpy")
def _draw_triangle(corner: np.ndarray, a: int, b: int, c: int, image: np.ndarray) -> None:
    """Draw one triangle, whose corners are the rows a, b and c of ``corner``: column, row and height.

    A pixel on a side that two triangles share is drawn with both.
    """
    last, slack = len(image) - 1, 1e-9
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
                if not image[i, j] >= height:  # ``>=`` is false for NaN, so unknown pixels are drawn
                    image[i, j] = height


@njit(cache=True)
def _lowest(one: float, other: float) -> float:
    """Return the smallest of 0, ``one`` and ``other``."""
    low = one if one < other else other
    return low if low < 0.0 else 0.0


def image_side(samples: int) -> int:
    """Return the number of pixels on a side of an image with ``samples`` pixels per cell.

    The image holds the cells, a margin of half a cell all around, and one more pixel all around for the gradients.
    """
    return (CELLS + 1) * samples + 2


def cell_shares(samples: int) -> np.ndarray:
    """Return (side, 3) float64: for each column (or row) of pixels, its Gaussian weight, and how two cells share this
    weight.

    A column lies between the middles of two neighbouring cells and counts for both. The second value is the index of
    the first of these cells (0 is the margin); the third is the fraction of the weight that the second cell gets.
    """
    # distance of each pixel from the image's middle, in widths of a cell
    away = (np.arange(image_side(samples)) - 0.5 * (image_side(samples) - 1)) / samples
    cell = away + 0.5 * CELLS + 0.5
    return np.stack([np.exp(-(away**2) / (0.5 * CELLS * CELLS)), np.floor(cell), cell - np.floor(cell)], axis=1)


@njit(cache=True)
def describe_image(image: np.ndarray, shares: np.ndarray, descriptor: np.ndarray) -> bool:
    """Fill descriptor (WIDTH,) float32, cells row after row; return False if the image has no known gradient.

    image (side, side): heights, rows downwards, NaN = unknown; side is the result of ``image_side``. shares: the result
    of ``cell_shares``. Gradients are central differences, but one-sided beside unknown pixels. A gradient's orientation
    is counted from the direction of the columns towards the direction of the rows. Gradients are weighted by a Gaussian
    with a sigma of two cells, and distributed linearly between cells and orientations. The result is scaled to unit
    length, values above ``CLIP`` are set to ``CLIP``, and the result is scaled again. Source: Lowe 2004
    (doi:10.1023/B:VISI.0000029664.99615.94), section 6.
    """
    side = len(image)
    bins = np.zeros((CELLS + 2, CELLS + 2, ORIENTATIONS))  # the cells have a margin, one cell wide, which is discarded
    across, length, turn = np.empty((CELLS + 2, ORIENTATIONS)), np.empty(side), np.empty(side)
    for i in range(1, side - 1):
        _row_gradients(image[i - 1], image[i], image[i + 1], length, turn)
        across[:] = 0.0
        for j in range(1, side - 1):
            if length[j] > 0.0:
                weight = length[j] * shares[j, 0]
                c, o = int(shares[j, 1]), int(turn[j])
                inner, onward = weight * shares[j, 2], (o + 1) % ORIENTATIONS
                outer, part = weight - inner, turn[j] - o
                across[c, o] += outer * (1.0 - part)
                across[c, onward] += outer * part
                across[c + 1, o] += inner * (1.0 - part)
                across[c + 1, onward] += inner * part
        r, lower = int(shares[i, 1]), shares[i, 0] * shares[i, 2]
        upper = shares[i, 0] - lower
        for c in range(CELLS + 2):
            for o in range(ORIENTATIONS):
                bins[r, c, o] += upper * across[c, o]
                bins[r + 1, c, o] += lower * across[c, o]
    kept = bins[1:-1, 1:-1]
    size = np.sqrt((kept * kept).sum())
    if not size > 0.0:
        return False
    clipped = np.minimum(kept / size, CLIP)
    clipped /= np.sqrt((clipped * clipped).sum())
    descriptor[:] = clipped.ravel()
    return True


@njit(cache=True, error_model="numpy")
def _row_gradients(above: np.ndarray, row: np.ndarray, below: np.ndarray, length: np.ndarray, turn: np.ndarray) -> None:
    """Fill the lengths (NaN = unknown) and the orientations, ``turn`` in [0, ORIENTATIONS), of the gradients at the
    pixels of ``row``, except its first and last pixel.
    """
    for j in range(1, len(row) - 1):
        dx, dy = _difference(row[j - 1], row[j], row[j + 1]), _difference(above[j], row[j], below[j])
        length[j] = np.sqrt(dx * dx + dy * dy)
        turn[j] = turn_fraction(dx, dy, 0.0) * ORIENTATIONS


@njit(cache=True)
def _difference(before: float, here: float, after: float) -> float:
    """Return ``after`` minus ``before``: the heights of the two neighbours of a pixel with the height ``here``.

    If one neighbour's height is unknown, return twice the difference between the other neighbour's height and ``here``.
    Return NaN if ``here`` is unknown, or both neighbours' heights are.
    """
    first = here if np.isnan(before) else before
    last = here if np.isnan(after) else after
    steps = 2.0 if np.isnan(before) != np.isnan(after) else 1.0
    known = not (np.isnan(here) or (np.isnan(before) and np.isnan(after)))
    return steps * (last - first) if known else np.nan
