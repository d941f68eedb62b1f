"""Connected pieces of a depth picture, cut where the depth jumps."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def _root(parent: np.ndarray, node: int) -> int:
    while parent[node] != node:
        parent[node] = parent[parent[node]]
        node = parent[node]
    return node


@njit(cache=True)
def _label(depth: np.ndarray, mask: np.ndarray, limit: np.ndarray) -> tuple[np.ndarray, int]:
    """Union-find over the 8-neighbourhood; labels 1... in the order of the first pixel."""
    height, width = depth.shape
    parent = np.arange(height * width, dtype=np.int32)
    for row in range(height):
        for column in range(width):
            if not mask[row, column]:
                continue
            here = row * width + column
            for d_row, d_column in ((0, -1), (-1, -1), (-1, 0), (-1, 1)):
                r, c = row + d_row, column + d_column
                if r < 0 or c < 0 or c >= width or not mask[r, c]:
                    continue
                if abs(depth[row, column] - depth[r, c]) > max(limit[row, column], limit[r, c]):
                    continue
                a, b = _root(parent, here), _root(parent, r * width + c)
                if a < b:
                    parent[b] = a
                elif b < a:
                    parent[a] = b
    labels = np.zeros((height, width), dtype=np.int32)
    count = 0
    for row in range(height):
        for column in range(width):
            if mask[row, column]:
                here = row * width + column
                root = _root(parent, here)
                if root == here:  # the smallest index of its piece, so it comes first
                    count += 1
                    labels[row, column] = count
                else:
                    labels[row, column] = labels[root // width, root % width]
    return labels, count


@njit(cache=True)
def _supported(depth: np.ndarray, mask: np.ndarray, limit: np.ndarray, needed: int) -> np.ndarray:
    height, width = depth.shape
    kept = np.zeros((height, width), dtype=np.bool_)
    for row in range(height):
        for column in range(width):
            if not mask[row, column]:
                continue
            support = 0
            for r in range(max(row - 1, 0), min(row + 2, height)):
                for c in range(max(column - 1, 0), min(column + 2, width)):
                    if mask[r, c] and abs(depth[row, column] - depth[r, c]) <= limit[row, column]:
                        support += 1
            kept[row, column] = support > needed  # the pixel itself is counted
    return kept


def label_components(depth_m: np.ndarray, mask: np.ndarray, limit_m: np.ndarray) -> tuple[np.ndarray, int]:
    """Pieces of ``mask`` whose neighbouring pixels (8-neighbourhood) differ in depth by at most ``limit_m``.

    depth_m, limit_m (height, width) float32 metres; mask (height, width) bool.
    Returns labels (height, width) int32, 0 = outside the mask, and how many pieces there are.
    """
    return _label(depth_m, mask, limit_m)


def without_flying_pixels(depth_m: np.ndarray, mask: np.ndarray, limit_m: np.ndarray) -> np.ndarray:
    """``mask`` without pixels that hang between two surfaces: fewer than three neighbours at their own depth.

    Time-of-flight cameras report such mixed depths along every silhouette. Three of eight is what the corner of a
    convex outline still has.
    """
    return _supported(depth_m, mask, limit_m, 3)


def jump_limit_m(depth_m: np.ndarray, noise: float, focal_px: float, gate: float, slope_rad: float) -> np.ndarray:
    """(height, width) float32: how far two neighbouring pixels of one surface may differ in depth, metres."""
    limit = gate * np.sqrt(2.0) * noise * depth_m**2 + depth_m * (np.tan(slope_rad) / focal_px)
    return limit.astype(np.float32)
