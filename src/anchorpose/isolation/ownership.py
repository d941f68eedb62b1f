"""Decide by likelihood the owner of each seen point (place): the person whose skin the point shows. The skin of a
person is expected at its predicted place or, without a prediction, where it was seen last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numba import njit

NOBODY: Final = 0
MIXED: Final = 255  # label of a cell with skin of several people
# m, side of a cell; skin is searched in a place's cell and the 26 cells around, so all skin nearer than this is found
CELL_M: Final = 0.035
# m, half the spacing of skin points; a place on the skin may be this far from the nearest skin point
SAMPLING_M: Final = 0.01
# sigmas, maximum distance of a skin point from a place; where the likelihoods of several people are compared, farther
# points do not count. If no skin point of any person is within this distance, the place gets its owner by region
# growing
GATE: Final = 3.0
# minimum lead of the most likely owner over all other people. The lead is the difference between two people's values of
# (d / sigma)^2 + 2 log(sigma), where d is the distance of a place from the person's skin, and sigma the standard
# deviation of this skin (``decide_ownership``)
LEAST_LEAD: Final = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class OwnershipLikelihood:
    """Points at which people's skin is expected, with their uncertainty."""

    points_m: np.ndarray  # (n, 3) float32, expected points on the skin, metres in the world frame
    owner: np.ndarray  # (n,) uint8, label of the person to whom each point belongs
    sigma_m: np.ndarray  # (n,) float32, standard deviation of the skin about the point

    def __len__(self) -> int:
        return len(self.points_m)


class LikelihoodGrid(NamedTuple):
    """The points of an ``OwnershipLikelihood`` sorted by cells: cell c has the points start[c] to start[c + 1] - 1."""

    points_m: np.ndarray  # (n, 3) float32, the points, cell by cell
    owner: np.ndarray  # (n,) uint8, label of the person to whom each point belongs
    weight: np.ndarray  # (n,) float32 = 1 / sigma^2
    penalty: np.ndarray  # (n,) float32 = 2 log(sigma)
    start: np.ndarray
    origin_m: np.ndarray  # (3,) float32, world, the first cell's corner, that is, its smallest x, y and z
    # (a, b, c) uint8, owner of the skin in a cell and the 26 cells around it: ``NOBODY``, a person's label or ``MIXED``
    around: np.ndarray


def join_likelihoods(parts: Sequence[OwnershipLikelihood]) -> OwnershipLikelihood:
    """Join the skin points of several likelihoods into one."""
    if not parts:
        return OwnershipLikelihood(np.zeros((0, 3), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.float32))
    return OwnershipLikelihood(
        np.concatenate([part.points_m for part in parts]).astype(np.float32, copy=False),
        np.concatenate([part.owner for part in parts]).astype(np.uint8, copy=False),
        np.concatenate([part.sigma_m for part in parts]).astype(np.float32, copy=False),
    )


def sort_likelihood(likelihood: OwnershipLikelihood) -> LikelihoodGrid:
    """Sort the skin points of a likelihood (at least one) into cells."""
    origin = (likelihood.points_m.min(axis=0) - CELL_M).astype(np.float32)
    cell = np.floor((likelihood.points_m - origin) / np.float32(CELL_M)).astype(np.int64)
    shape = cell.max(axis=0) + 2
    flat = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
    start = np.zeros(int(shape.prod()) + 1, np.int32)
    np.cumsum(np.bincount(flat, minlength=int(shape.prod())), out=start[1:])
    order = np.argsort(flat, kind="stable")
    around = np.zeros(shape, np.uint8)
    _spread_owners(around, cell, likelihood.owner)
    sigma_m = likelihood.sigma_m[order]
    weight, penalty = 1.0 / sigma_m**2, 2.0 * np.log(sigma_m)
    return LikelihoodGrid(likelihood.points_m[order], likelihood.owner[order], weight, penalty, start, origin, around)


@njit(cache=True, nogil=True)
def _spread_owners(around: np.ndarray, cell: np.ndarray, owner: np.ndarray) -> None:
    """Write the owner of each skin point to the point's cell in ``around`` and to the 26 cells around this cell; a cell
    that gets several owners is ``MIXED``. All points must be at least one cell away from the lower border of the grid.
    """
    before = np.full(3, -1, np.int64)
    whose = 0
    for i in range(len(cell)):
        if owner[i] == whose and (cell[i] == before).all():
            continue
        whose = owner[i]
        for axis in range(3):  # a loop, since numba takes four seconds longer to compile a slice
            before[axis] = cell[i, axis]
        for x in range(cell[i, 0] - 1, cell[i, 0] + 2):
            for y in range(cell[i, 1] - 1, cell[i, 1] + 2):
                for z in range(cell[i, 2] - 1, cell[i, 2] + 2):
                    if around[x, y, z] == 0:
                        around[x, y, z] = whose
                    elif around[x, y, z] != whose:
                        around[x, y, z] = MIXED


def decide_ownership(
    grid: LikelihoodGrid, places_m: np.ndarray, compared: np.ndarray, gate: float = GATE, least_lead: float = LEAST_LEAD
) -> np.ndarray:
    """Return (m,) uint8: the clear owner of each place (m, 3) float32, that is, the person whose skin is there;
    ``NOBODY`` if no owner is clear.

    Space is divided into cubes (cells). If all skin in the cell of a place and in the 26 cells around this cell belongs
    to one person, that person owns the place. Otherwise the most likely owner is chosen, but only where ``compared``
    (m,) bool is True. The most likely owner is the person with the least (d / sigma)^2 + 2 log(sigma), where d is the
    distance of the place from the person's skin, and sigma the standard deviation of this skin
    (``OwnershipLikelihood``). This value must be less than the value of every other person by at least ``least_lead``,
    otherwise the place has no clear owner. Skin farther away than ``gate`` times its sigma does not count.
    """
    return _decide(grid, places_m, compared, gate, least_lead)


@njit(cache=True, nogil=True)
def _decide(
    grid: LikelihoodGrid, places: np.ndarray, compared: np.ndarray, gate: float, least_lead: float
) -> np.ndarray:
    points, owners, weight, penalty = grid.points_m, grid.owner, grid.weight, grid.penalty
    start, origin, around = grid.start, grid.origin_m, grid.around
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
        if not compared[i]:
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
