"""Where the depth picture jumps: flying pixels, and which neighbouring pixels lie on one skin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit


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
    return _supported(depth_m.astype(np.float32), np.float64(slope), np.float64(spread), min_support)


@njit(cache=True)
def _supported(depth: np.ndarray, slope: float, spread: float, min_support: int) -> np.ndarray:
    height, width = depth.shape
    kept = np.zeros_like(depth)
    for row in range(height):
        for col in range(width):
            z = np.float64(depth[row, col])
            if z <= 0.0:
                continue
            limit = slope * z + spread * z * z
            support = 0
            for i in range(max(0, row - 1), min(height, row + 2)):
                for j in range(max(0, col - 1), min(width, col + 2)):
                    if (i != row or j != col) and depth[i, j] > 0.0 and abs(depth[i, j] - z) <= limit:
                        support += 1
            if support >= min_support:
                kept[row, col] = depth[row, col]
    return kept
