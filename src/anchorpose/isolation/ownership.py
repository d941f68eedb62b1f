"""Who may own a place: every person's skin where it is expected, and how sure that is.

Who owns the pixels that nobody claims for sure: whoever they hang together with, up to the nearest crease.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from anchorpose.isolation.scene import Pieces

CELL_M = 0.035  # claims are looked for in the cell of a place and the 26 around it: all within this distance count
MIXED = 255  # no label
SAMPLING_M = 0.01  # half the distance of neighbouring claims: so far from the nearest one a place is still on the skin


@dataclass(frozen=True, slots=True, eq=False)
class OwnershipLikelihood:
    """points_m (n, 3) float32 world: skin, sampled; owner (n,) uint8 label; sigma_m (n,) float32: spread about it."""

    points_m: np.ndarray
    owner: np.ndarray
    sigma_m: np.ndarray

    def __len__(self) -> int:
        return len(self.points_m)


@dataclass(frozen=True, slots=True, eq=False)
class LikelihoodGrid:
    """OwnershipLikelihood sorted by cells: those of cell c are start[c] to start[c + 1].

    origin_m (3,) float32; around (a, b, c) uint8: who has claims in a cell and the 26 around it, 0 = nobody, MIXED =
    more than one person.
    """

    likelihood: OwnershipLikelihood
    start: np.ndarray
    origin_m: np.ndarray
    around: np.ndarray


def join_likelihoods(parts: Sequence[OwnershipLikelihood]) -> OwnershipLikelihood:
    """All claims together."""
    if not parts:
        return OwnershipLikelihood(np.zeros((0, 3), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.float32))
    return OwnershipLikelihood(
        np.concatenate([part.points_m for part in parts]).astype(np.float32, copy=False),
        np.concatenate([part.owner for part in parts]).astype(np.uint8, copy=False),
        np.concatenate([part.sigma_m for part in parts]).astype(np.float32, copy=False),
    )


def sort_likelihood(likelihood: OwnershipLikelihood) -> LikelihoodGrid:
    """Sort claims (at least one) into cells."""
    origin = (likelihood.points_m.min(axis=0) - CELL_M).astype(np.float32)
    cell = np.floor((likelihood.points_m - origin) / np.float32(CELL_M)).astype(np.int64)
    shape = cell.max(axis=0) + 2
    flat = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
    start = np.zeros(int(shape.prod()) + 1, np.int32)
    np.cumsum(np.bincount(flat, minlength=int(shape.prod())), out=start[1:])
    order = np.argsort(flat, kind="stable")
    around = np.zeros(shape, np.uint8)
    _spread_owners(around, cell, likelihood.owner)
    ordered = OwnershipLikelihood(likelihood.points_m[order], likelihood.owner[order], likelihood.sigma_m[order])
    return LikelihoodGrid(ordered, start, origin, around)


def decide_ownership(
    grid: LikelihoodGrid, places_m: np.ndarray, asked: np.ndarray, gate: float, least_lead: float
) -> np.ndarray:
    """(m,) uint8: who claims each place (m, 3) float32 for sure, 0 = nobody.

    Where all claims around are one person's, it is his. Elsewhere, and only where ``asked`` (m,) bool, the strongest
    claim decides, that is the least (d / sigma)^2 + 2 log(sigma) with d the distance to the skin: the likelihood of a
    reading that is off the skin by d. It has to lead everybody else's by ``least_lead``; claims farther off than
    ``gate`` of their sigmas do not count.
    """
    likelihood = grid.likelihood
    weight, penalty = 1.0 / likelihood.sigma_m**2, 2.0 * np.log(likelihood.sigma_m)
    return _decide(
        likelihood.points_m,
        likelihood.owner,
        weight,
        penalty,
        grid.start,
        grid.origin_m,
        grid.around,
        places_m,
        asked,
        gate,
        least_lead,
    )


@njit(cache=True)
def _spread_owners(around: np.ndarray, cell: np.ndarray, owner: np.ndarray) -> None:
    """Every claim into its own and the 26 cells around; all claims keep one cell off the lower border."""
    before = np.full(3, -1, np.int64)
    whose = 0
    for i in range(len(cell)):
        if owner[i] == whose and (cell[i] == before).all():
            continue
        before[:], whose = cell[i], owner[i]
        for x in range(cell[i, 0] - 1, cell[i, 0] + 2):
            for y in range(cell[i, 1] - 1, cell[i, 1] + 2):
                for z in range(cell[i, 2] - 1, cell[i, 2] + 2):
                    if around[x, y, z] == 0:
                        around[x, y, z] = whose
                    elif around[x, y, z] != whose:
                        around[x, y, z] = MIXED


@njit(cache=True)
def _decide(
    points: np.ndarray,
    owners: np.ndarray,
    weight: np.ndarray,
    penalty: np.ndarray,
    start: np.ndarray,
    origin: np.ndarray,
    around: np.ndarray,
    places: np.ndarray,
    asked: np.ndarray,
    gate: float,
    least_lead: float,
) -> np.ndarray:
    shape = around.shape
    won = np.zeros(len(places), np.uint8)
    cell_m = np.float32(CELL_M)
    for i in range(len(places)):
        x0 = int(np.floor((places[i, 0] - origin[0]) / cell_m))
        y0 = int(np.floor((places[i, 1] - origin[1]) / cell_m))
        z0 = int(np.floor((places[i, 2] - origin[2]) / cell_m))
        if x0 < 0 or y0 < 0 or z0 < 0 or x0 >= shape[0] or y0 >= shape[1] or z0 >= shape[2]:
            continue
        if around[x0, y0, z0] != MIXED:
            won[i] = around[x0, y0, z0]
            continue
        if not asked[i]:
            continue
        best, rival, owner = np.float32(np.inf), np.float32(np.inf), 0
        for x in range(max(x0 - 1, 0), min(x0 + 2, shape[0])):
            for y in range(max(y0 - 1, 0), min(y0 + 2, shape[1])):
                row = (x * shape[1] + y) * shape[2]
                for k in range(start[row + max(z0 - 1, 0)], start[row + min(z0 + 2, shape[2])]):
                    d_x, d_y = points[k, 0] - places[i, 0], points[k, 1] - places[i, 1]
                    d_z = points[k, 2] - places[i, 2]
                    distance = max(np.sqrt(d_x * d_x + d_y * d_y + d_z * d_z) - np.float32(SAMPLING_M), 0.0)
                    squared = distance * distance * weight[k]
                    if squared > gate * gate:
                        continue
                    cost = squared + penalty[k]
                    if owners[k] == owner:
                        best = min(best, cost)
                    elif cost < best:
                        rival, best, owner = best, cost, owners[k]
                    elif cost < rival:
                        rival = cost
        if owner > 0 and rival - best >= least_lead:
            won[i] = owner
    return won


NOBODY = 0
CREASE_PX = 3  # a crease is looked for over three pixels to either side: a finger's width at 2.5 m
DEEPEST = 60  # steps that a crease may cost: as many pixels as a forearm is long


def grow_regions(view: Pieces, owner: np.ndarray, crease_cost: float) -> np.ndarray:
    """Spread owners over the surface along the cheapest ways, until they meet or the depth jumps.

    owner (n,) uint8 for each foreground pixel: NOBODY where it is still open. A step costs one, and in a valley more:
    ``crease_cost`` steps for each deviation of the noise that the surface lies behind its neighbours on both sides.
    Two bodies that touch meet in such a valley. Returns (n,) uint8; NOBODY remains where a pixel hangs together with no
    owned one.
    """
    grown = owner.copy()
    _spread(
        view.index,
        view.depth_m,
        view.limit.square,
        view.limit.slope,
        view.row,
        view.column,
        grown,
        crease_cost,
        float(np.sqrt(1.5)) * view.noise_per_m,
    )
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
    grid: np.ndarray,
    depth: np.ndarray,
    square: float,
    slope: float,
    row: np.ndarray,
    column: np.ndarray,
    owner: np.ndarray,
    crease_cost: float,
    noise: float,
) -> None:
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
