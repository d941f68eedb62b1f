"""Find connected pieces of a depth frame. A piece ends where the depth jumps by more than it can within one surface."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit

# minimum number of a pixel's eight neighbours that lie at its depth; a pixel with fewer is a flying pixel. Even a pixel
# at the corner of a convex outline has three neighbours at its depth.
SUPPORT: Final = 3
# standard deviations (sigmas), maximum depth difference that noise causes between neighbouring pixels of one surface;
# on a slanted surface, the depth also differs because of the slope
JUMP_GATE: Final = 4.0
# rad (80 degrees), maximum slant of a surface that returns readings; 0 = the surface faces the camera
STEEPEST_SLOPE_RAD: Final = 1.40


class JumpLimit(NamedTuple):
    """Largest depth difference between neighbouring pixels of one surface: ``square z^2 + slope z`` m at depth z."""

    square: float  # 1/m, factor of z^2, due to noise
    slope: float  # factor of z: change of depth per pixel on the steepest surface that returns a reading

    def at(self, depth_m: np.ndarray) -> np.ndarray:
        """Return, for each pixel of ``depth_m``, by how much the depth of a neighbouring pixel may differ if both show
        the same surface, in an array of the same shape.
        """
        return self.square * depth_m**2 + self.slope * depth_m


def jump_limit(noise_per_m: float, focal_px: float) -> JumpLimit:
    """Return the limit of depth differences for a sensor whose readings at depth z have the standard deviation
    ``noise_per_m z^2``. The limit is the change of depth per pixel on the steepest surface, plus ``JUMP_GATE`` standard
    deviations of the difference between two readings.
    """
    return JumpLimit(float(JUMP_GATE * np.sqrt(2.0) * noise_per_m), float(np.tan(STEEPEST_SLOPE_RAD) / focal_px))


@njit(cache=True, nogil=True)
def unite(root: np.ndarray, one: Any, other: Any) -> None:
    """Join the sets to which two nodes belong; the smaller of their roots becomes the root of the joined set. root (n,)
    int32: a union-find forest, in which the nodes of a set have the same root.
    """
    one, other = find_root(root, one), find_root(root, other)
    if one < other:
        root[other] = one
    else:
        root[one] = other


@njit(cache=True, nogil=True)
def find_root(root: np.ndarray, node: Any) -> Any:
    """Return the root of a node's set, and shorten the path to it. Callers pass ``node`` as int64, so numba compiles
    the function for one type only.
    """
    while root[node] != node:
        root[node] = root[root[node]]
        node = root[node]
    return node


@njit(cache=True, nogil=True)
def label_components(depth_m: np.ndarray, mask: np.ndarray, limit: JumpLimit) -> tuple[np.ndarray, int]:
    """Return the pieces of ``mask`` in which neighbouring pixels (8-neighbourhood) differ in depth by at most the
    limit.

    depth_m (height, width) float32 metres; mask (height, width) bool. For two pixels, the limit at the greater depth
    applies. Return labels (height, width) int32, 0 outside the mask, else from 1 in the order of the pieces' first
    pixels; and the number of pieces. In the union-find forest, the root of a piece is the smallest index among its
    pixels.
    """
    height, width = depth_m.shape
    parent = np.empty(height * width, dtype=np.int32)
    for row in range(height):
        for column in range(width):
            if not mask[row, column]:
                continue
            here = row * width + column
            parent[here] = here
            for d_row, d_column in ((0, -1), (-1, -1), (-1, 0), (-1, 1)):
                r, c = row + d_row, column + d_column
                if r < 0 or c < 0 or c >= width or not mask[r, c]:
                    continue
                far = max(depth_m[row, column], depth_m[r, c])
                if abs(depth_m[row, column] - depth_m[r, c]) <= limit.square * far * far + limit.slope * far:
                    unite(parent, here, r * width + c)
    labels = np.zeros((height, width), dtype=np.int32)
    count = 0
    for row in range(height):
        for column in range(width):
            if mask[row, column]:
                here = row * width + column
                root = find_root(parent, here)
                if root == here:
                    count += 1
                    labels[row, column] = count
                else:
                    labels[row, column] = labels[root // width, root % width]
    return labels, count


@njit(cache=True, nogil=True)
def without_flying_pixels(depth_m: np.ndarray, mask: np.ndarray, limit: JumpLimit) -> np.ndarray:
    """Return ``mask`` without flying pixels: pixels with fewer than three neighbours at their depth.

    Along every silhouette, time-of-flight cameras report such mixed depths, which lie between the depths of two
    surfaces.
    """
    height, width = depth_m.shape
    kept = np.zeros((height, width), dtype=np.bool_)
    for row in range(height):
        for column in range(width):
            if mask[row, column]:
                kept[row, column] = _has_support(depth_m, mask, row, column, limit)
    return kept


@njit(cache=True, nogil=True)
def _has_support(depth: np.ndarray, mask: np.ndarray, row: int, column: int, limit: JumpLimit) -> bool:
    height, width = depth.shape
    z = depth[row, column]
    largest = limit.square * z * z + limit.slope * z
    support = 0
    for r in range(max(row - 1, 0), min(row + 2, height)):
        for c in range(max(column - 1, 0), min(column + 2, width)):
            if mask[r, c] and abs(z - depth[r, c]) <= largest:
                support += 1
        if support > SUPPORT:  # the count includes the pixel itself
            return True
    return False
