"""Who owns the pixels that no prediction reaches: whoever they hang together with."""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.isolation.scene import Pieces

NOBODY, PATIENT, OTHER = 0, 1, 2


def grow_owners(view: Pieces, owner: np.ndarray) -> np.ndarray:
    """Spread owners over the surface, neighbour by neighbour, until they meet or the depth jumps.

    owner (n,) uint8 for each foreground pixel: NOBODY where it is still open. Returns (n,) uint8; NOBODY remains where
    a pixel hangs together with no owned one. Ties go to the patient.
    """
    grid = np.full(view.depth_m.shape, -1, np.int32)
    grid[view.row, view.column] = np.arange(len(view.row), dtype=np.int32)
    grown = owner.copy()
    _spread(grid, view.depth_m, view.jump_limit_m, view.row, view.column, grown)
    return grown


@njit(cache=True)
def _spread(
    grid: np.ndarray, depth: np.ndarray, limit: np.ndarray, row: np.ndarray, column: np.ndarray, owner: np.ndarray
) -> None:
    """Breadth first from all owned pixels at once; the queue holds every pixel at most once."""
    height, width = grid.shape
    queue = np.empty(len(owner), np.int32)
    end = 0
    for wanted in (PATIENT, OTHER):
        for pixel in range(len(owner)):
            if owner[pixel] == wanted:
                queue[end] = pixel
                end += 1
    start = 0
    while start < end:
        pixel = queue[start]
        start += 1
        r, c = row[pixel], column[pixel]
        for d_r, d_c in ((0, -1), (-1, 0), (0, 1), (1, 0)):
            nr, nc = r + d_r, c + d_c
            if nr < 0 or nc < 0 or nr >= height or nc >= width:
                continue
            other = grid[nr, nc]
            if other < 0 or owner[other] != NOBODY:
                continue
            if abs(depth[r, c] - depth[nr, nc]) > max(limit[r, c], limit[nr, nc]):
                continue
            owner[other] = owner[pixel]
            queue[end] = other
            end += 1
