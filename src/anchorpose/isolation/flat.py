"""Boards, doors and cloths held up: things in front of the room that are too flat and too square to be a body."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit

LEAST_M2 = 0.15  # a smaller patch of a body, cut out by bars, may be flat
FLATTEST = 0.025  # deviation from a plane over the width; trunks bulge by 5 %
LEAST_FILLED = 0.85  # of the smallest rectangle around it; a trunk with thighs fills less
SAMPLE = 500  # points of a piece that are asked


def flat_pieces(
    points_m: np.ndarray, depth_m: np.ndarray, piece: np.ndarray, area_m2: np.ndarray, noise_per_m: float
) -> np.ndarray:
    """(n,) bool: pixels of pieces that are planes within the noise and ``FLATTEST`` of their width, and rectangles.

    points_m (n, 3), depth_m (n,), piece (n,) from 1, area_m2 (n,): the foreground pixels of one camera.
    """
    area = np.bincount(piece, area_m2, minlength=1)
    flat = np.zeros(len(area), dtype=bool)
    for large in np.flatnonzero(area > LEAST_M2):
        mine = np.flatnonzero(piece == large)
        mine = mine[:: max(1, len(mine) // SAMPLE)]
        own = points_m[mine].astype(np.float64)
        own -= own.mean(axis=0)
        spread, axes = np.linalg.eigh(own.T @ own / len(own))
        across = np.abs(own @ axes[:, 0])
        thickness = 1.483 * _median(across)  # of most of it: a hand at the edge may stick out
        noise = noise_per_m * _median(depth_m[mine]) ** 2
        if thickness - noise > FLATTEST * np.sqrt(12.0 * spread[1]):  # a width w has variance w^2 / 12
            continue
        _, sides, _ = cv2.minAreaRect((own @ axes[:, 1:]).astype(np.float32))
        facing = area[large]  # as if it faced the camera: less than it is, so a slanting board may be missed
        flat[large] = facing > LEAST_FILLED * sides[0] * sides[1]
    return flat[piece]


@njit(cache=True)
def _median(values: np.ndarray) -> float:
    """As ``np.median``, which takes ten times as long for a few hundred."""
    return np.float64(np.median(values))
