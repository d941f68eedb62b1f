"""The SIFT descriptor of a small upright picture, some of whose pixels may be unknown (Lowe 2004)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from anchorpose.research.features.circle import turn_fraction

CELLS: Final = 4  # a side
ORIENTATIONS: Final = 8
WIDTH: Final = CELLS * CELLS * ORIENTATIONS
MARGIN: Final = 0.5  # cells around all that still share in the outermost ones
CLIP: Final = 0.2  # of the unit length: no single edge may outweigh the rest


def picture_side(samples: int) -> int:
    """Pixels on a side of a picture with so many a cell: cells, margins, and a pixel all around for the gradients."""
    return (CELLS + 1) * samples + 2


def places(samples: int) -> np.ndarray:
    """(side, 3) float64: of each column, or row, its Gaussian weight, the first of the two cells that it shares in
    (0 is the margin's), and the second one's part."""
    away = (np.arange(picture_side(samples)) - 0.5 * (picture_side(samples) - 1)) / samples  # cells from the middle
    cell = away + 0.5 * CELLS + 0.5
    return np.stack([np.exp(-(away**2) / (0.5 * CELLS * CELLS)), np.floor(cell), cell - np.floor(cell)], axis=1)


@njit(cache=True)
def describe(picture: np.ndarray, table: np.ndarray, descriptor: np.ndarray) -> bool:
    """Fills descriptor (WIDTH,) float32, cells row after row; False where the picture has no known gradient.

    picture (side, side) of ``picture_side``, row downwards, NaN unknown; table of ``places``. Gradients are central
    differences, one-sided beside unknown pixels, their orientations counted from the columns' direction towards the
    rows'. Gaussian weight of sigma two cells; shared between two cells each way and two orientations; unit length,
    clipped, unit length again. Source: Lowe 2004 (doi:10.1023/B:VISI.0000029664.99615.94), section 6.
    """
    side = len(picture)
    bins = np.zeros((CELLS + 2, CELLS + 2, ORIENTATIONS))  # the outer cells take what is not wanted
    across, length, turn = np.empty((CELLS + 2, ORIENTATIONS)), np.empty(side), np.empty(side)
    for i in range(1, side - 1):
        _row_gradients(picture[i - 1], picture[i], picture[i + 1], length, turn)
        across[:] = 0.0
        for j in range(1, side - 1):
            if length[j] > 0.0:
                weight = length[j] * table[j, 0]
                c, o = int(table[j, 1]), int(turn[j])
                inner, onward = weight * table[j, 2], (o + 1) % ORIENTATIONS
                outer, share = weight - inner, turn[j] - o
                across[c, o] += outer * (1.0 - share)
                across[c, onward] += outer * share
                across[c + 1, o] += inner * (1.0 - share)
                across[c + 1, onward] += inner * share
        r, lower = int(table[i, 1]), table[i, 0] * table[i, 2]
        upper = table[i, 0] - lower
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
    """Length, NaN where it is unknown, and orientation in [0, ORIENTATIONS) of a row's gradients but the outermost."""
    for j in range(1, len(row) - 1):
        dx, dy = _difference(row[j - 1], row[j], row[j + 1]), _difference(above[j], row[j], below[j])
        length[j] = np.sqrt(dx * dx + dy * dy)
        turn[j] = turn_fraction(dx, dy, 0.0) * ORIENTATIONS


@njit(cache=True)
def _difference(before: float, here: float, after: float) -> float:
    """Over two pixels, from one side where the other is unknown; NaN where it cannot be told."""
    first = here if np.isnan(before) else before
    last = here if np.isnan(after) else after
    steps = 2.0 if np.isnan(before) != np.isnan(after) else 1.0
    known = not (np.isnan(here) or (np.isnan(before) and np.isnan(after)))
    return steps * (last - first) if known else np.nan
