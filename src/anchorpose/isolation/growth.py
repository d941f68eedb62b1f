"""Who owns the pixels that nobody claims for sure: whoever they hang together with, up to the nearest crease."""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.isolation.scene import Pieces

NOBODY = 0
CREASE_PX = 3  # a crease is looked for over three pixels to either side: a finger's width at 2.5 m
DEEPEST = 60  # steps that a crease may cost: as many pixels as a forearm is long


def grow_owners(view: Pieces, owner: np.ndarray, crease_cost: float) -> np.ndarray:
    """Spread owners over the surface along the cheapest ways, until they meet or the depth jumps.

    owner (n,) uint8 for each foreground pixel: NOBODY where it is still open. A step costs one, and in a valley more:
    ``crease_cost`` steps for each deviation of the noise that the surface lies behind its neighbours on both sides.
    Two bodies that touch meet in such a valley. Returns (n,) uint8; NOBODY remains where a pixel hangs together with no
    owned one.
    """
    grown = owner.copy()
    _spread(
        view.index, view.depth_m, view.limit.square, view.limit.slope, view.row, view.column,
        grown, crease_cost, float(np.sqrt(1.5)) * view.noise_per_m,
    )  # fmt: skip
    return grown


@njit(cache=True)
def _valley(grid: np.ndarray, depth: np.ndarray, r: int, c: int, d_r: int, d_c: int) -> float:
    """How far the surface at a pixel lies behind the middle of its two neighbours along a direction, metres."""
    height, width = grid.shape
    r1, c1, r2, c2 = r - CREASE_PX * d_r, c - CREASE_PX * d_c, r + CREASE_PX * d_r, c + CREASE_PX * d_c
    if min(r1, r2, c1, c2) < 0 or max(r1, r2) >= height or max(c1, c2) >= width:
        return 0.0
    if grid[r1, c1] < 0 or grid[r2, c2] < 0:
        return 0.0
    return depth[r, c] - 0.5 * (depth[r1, c1] + depth[r2, c2])


@njit(cache=True)
def _spread(
    grid: np.ndarray, depth: np.ndarray, square: float, slope: float, row: np.ndarray, column: np.ndarray,
    owner: np.ndarray, crease_cost: float, noise: float,
) -> None:  # fmt: skip
    """Dijkstra with a ring of buckets, linked lists of pixels; costs are whole steps."""
    height, width = grid.shape
    ring = DEEPEST + 2
    head = np.full(ring, -1, np.int32)
    count = 0
    for pixel in range(len(owner)):
        count += owner[pixel] != NOBODY
    capacity = 4 * (len(owner) - count) + count + 1
    entry_pixel, entry_owner = np.empty(capacity, np.int32), np.empty(capacity, np.uint8)
    after = np.empty(capacity, np.int32)
    used = 0
    for pixel in range(len(owner) - 1, -1, -1):  # only those beside open pixels need to be asked
        if owner[pixel] == NOBODY:
            continue
        beside = False
        for d_r, d_c in ((0, -1), (-1, 0), (0, 1), (1, 0)):
            r, c = row[pixel] + d_r, column[pixel] + d_c
            if 0 <= r < height and 0 <= c < width and grid[r, c] >= 0 and owner[grid[r, c]] == NOBODY:
                beside = True
        if beside:
            entry_pixel[used], entry_owner[used], after[used] = pixel, NOBODY, head[0]
            head[0] = used
            used += 1
    level, left = 0, used
    while left > 0:
        place = level % ring
        while head[place] >= 0:
            entry = head[place]
            head[place] = after[entry]
            left -= 1
            pixel = entry_pixel[entry]
            if entry_owner[entry] != NOBODY:
                if owner[pixel] != NOBODY:
                    continue
                owner[pixel] = entry_owner[entry]
            r, c = row[pixel], column[pixel]
            for d_r, d_c in ((0, -1), (-1, 0), (0, 1), (1, 0)):
                nr, nc = r + d_r, c + d_c
                if nr < 0 or nc < 0 or nr >= height or nc >= width:
                    continue
                other = grid[nr, nc]
                if other < 0 or owner[other] != NOBODY:
                    continue
                far = max(depth[r, c], depth[nr, nc])
                if abs(depth[r, c] - depth[nr, nc]) > square * far * far + slope * far:
                    continue
                valley = _valley(grid, depth, nr, nc, d_r, d_c) / (noise * far * far)
                steps = 1 + min(int(crease_cost * max(valley - 2.0, 0.0)), DEEPEST)
                entry_pixel[used], entry_owner[used] = other, owner[pixel]
                bucket = (level + steps) % ring
                after[used] = head[bucket]
                head[bucket] = used
                used += 1
                left += 1
        level += 1
