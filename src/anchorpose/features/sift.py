"""The SIFT descriptor of a small upright picture, some of whose pixels may be unknown (Lowe 2004)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from anchorpose.features.circle import turn_fraction

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
    for i in range(1, side - 1):
        r, dr = int(table[i, 1]), table[i, 2]
        for j in range(1, side - 1):
            here = picture[i, j]
            dx = _difference(picture[i, j - 1], here, picture[i, j + 1])
            dy = _difference(picture[i - 1, j], here, picture[i + 1, j])
            length = np.sqrt(dx * dx + dy * dy)
            if not length > 0.0:
                continue
            weight = length * table[i, 0] * table[j, 0]
            turn = turn_fraction(dx, dy, 0.0) * ORIENTATIONS
            c, dc, o = int(table[j, 1]), table[j, 2], int(turn)
            do, onward = turn - o, (o + 1) % ORIENTATIONS
            for a in range(2):
                for b in range(2):
                    share = weight * (dr if a else 1.0 - dr) * (dc if b else 1.0 - dc)
                    bins[r + a, c + b, o] += share * (1.0 - do)
                    bins[r + a, c + b, onward] += share * do
    kept = bins[1:-1, 1:-1]
    size = np.sqrt((kept * kept).sum())
    if not size > 0.0:
        return False
    clipped = np.minimum(kept / size, CLIP)
    clipped /= np.sqrt((clipped * clipped).sum())
    descriptor[:] = clipped.ravel()
    return True


@njit(cache=True)
def _difference(before: float, here: float, after: float) -> float:
    """Over two pixels, from one side where the other is unknown; NaN where it cannot be told."""
    both = after - before
    if not np.isnan(both):
        return both if not np.isnan(here) else np.nan
    return 2.0 * (here - before) if np.isnan(after) else 2.0 * (after - here)
