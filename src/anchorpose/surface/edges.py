"""Where the depth picture jumps: flying pixels, and which neighbouring pixels lie on one skin.

Which nodes hang together, by union-find on the surface's own arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from anchorpose.surface.denoise import extent, span


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeConfig:
    """When two neighbouring pixels lie on one skin."""

    max_slant_deg: float = 76.0  # skin seen flatter than this is a few pixels wide; arms before the trunk jump more
    noise_sigmas: float = 2.0  # of the raw noise; what smoothing leaves of it at an edge is about half
    min_support: int = 3  # a fingertip two pixels wide still has three neighbours on it; a flying pixel has fewer

    def __post_init__(self) -> None:
        if not 0 < self.max_slant_deg < 90:
            raise ValueError(f"max_slant_deg must lie in (0, 90), got {self.max_slant_deg}")
        if not self.noise_sigmas >= 0:
            raise ValueError(f"noise_sigmas must not be negative, got {self.noise_sigmas}")
        if not 0 <= self.min_support <= 8:
            raise ValueError(f"min_support must lie in 0..8, got {self.min_support}")


def jump_coefficients(focal_px: float, noise: float, config: EdgeConfig) -> tuple[float, float]:
    """(slope, spread): neighbours one pixel apart at depth z are on one skin up to ``slope * z + spread * z**2``."""
    return float(np.tan(np.radians(config.max_slant_deg))) / focal_px, config.noise_sigmas * noise


def drop_flying_pixels(depth_m: np.ndarray, slope: float, spread: float, min_support: int) -> np.ndarray:
    """The depth without readings that hang in the air between two surfaces.

    depth_m (height, width) float32 metres, 0 = no reading. A pixel stays when at least ``min_support`` of its eight
    neighbours are within the jump limit of ``jump_coefficients``.
    """
    depth = np.ascontiguousarray(depth_m, dtype=np.float32)
    return _supported(depth, np.float32(slope), np.float32(spread), min_support, *extent(depth))


@njit(cache=True)
def _supported(
    depth: np.ndarray, slope: Any, spread: Any, min_support: int, top: int, bottom: int, left: int, right: int
) -> np.ndarray:
    kept, width = np.zeros_like(depth), depth.shape[1]
    limit, support = np.empty(width, np.float32), np.empty(width, np.int32)
    for row in range(top, bottom):
        first, last = span(depth, row, left, right)
        for col in range(first, last):
            limit[col] = slope * depth[row, col] + spread * depth[row, col] * depth[row, col]
            support[col] = -1  # itself
        for i in range(max(0, row - 1), min(depth.shape[0], row + 2)):
            for j in range(-1, 2):
                low, high = max(first, -j), min(last, width - j)
                _count_tap(
                    depth, np.uint64(row), np.uint64(i), np.uint64(low), np.uint64(low + j),
                    np.uint64(max(high - low, 0)), limit, support,
                )  # fmt: skip
        for col in range(first, last):
            if depth[row, col] > 0.0 and support[col] >= min_support:
                kept[row, col] = depth[row, col]
    return kept


@njit(cache=True)
def _count_tap(
    depth: np.ndarray, row: Any, i: Any, at: Any, there: Any, count: Any, limit: np.ndarray, support: np.ndarray
) -> None:
    """One neighbour of each pixel of a row; unsigned, so that no index can mean one from the end."""
    for k in range(count):
        z = depth[i, there + k]
        support[at + k] += np.int32((z > np.float32(0.0)) & (abs(z - depth[row, at + k]) <= limit[at + k]))


@njit(cache=True)
def connected_pieces(ring: np.ndarray, link_start: np.ndarray, link_node: np.ndarray) -> np.ndarray:
    """(n,) int32: number of each node's piece, counted in the order of the pieces' first nodes.

    ring (n, 8), link_start (n + 1,), link_node (m,) int32 of ``Surface``. The root of a piece is its first node.
    Source: Tarjan 1975 (doi:10.1145/321879.321884), with path halving.
    """
    count = len(ring)
    root = np.arange(count, dtype=np.int32)
    for node in range(count):
        for place in range(4):  # E NE N NW: every edge of the grid once
            if ring[node, place] >= 0:
                _unite(root, node, ring[node, place])
        for spot in range(link_start[node], link_start[node + 1]):
            _unite(root, node, link_node[spot])
    piece = np.empty(count, np.int32)
    found = 0
    for node in range(count):
        first = _find(root, node)
        if first == node:
            piece[node] = found
            found += 1
        else:
            piece[node] = piece[first]
    return piece


@njit(cache=True)
def _unite(root: np.ndarray, one: int, other: int) -> None:
    one, other = _find(root, one), _find(root, other)
    if one < other:
        root[other] = one
    else:
        root[one] = other


@njit(cache=True)
def _find(root: np.ndarray, node: int) -> int:
    while root[node] != node:
        root[node] = root[root[node]]
        node = root[node]
    return node
