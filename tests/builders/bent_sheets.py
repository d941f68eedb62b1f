"""A sheet, the same sheet bent without stretching it, and a hill that is not a bent sheet."""

import numpy as np
from surface_builder import flat_grid, grid_surface

from anchorpose.surface.surface import Surface

SPACING = 0.02


def sheet(rows=7, cols=9) -> Surface:
    return flat_grid(rows, cols, SPACING)


def bent(turn_rad: float, rows=7, cols=9) -> Surface:
    """The same sheet folded along every column by one angle: each cell stays flat and keeps its sides."""
    heading = turn_rad * np.arange(cols - 1)
    x = np.concatenate([[0.0], np.cumsum(np.sin(heading))]) * SPACING
    z = np.concatenate([[0.0], np.cumsum(np.cos(heading))]) * SPACING
    points = np.empty((rows, cols, 3))
    points[..., 0], points[..., 2] = x, -z
    points[..., 1] = -np.arange(rows)[:, None] * SPACING
    return grid_surface(points)


def hill(height_m: float, rows=7, cols=9) -> Surface:
    """A sheet of its own shape, no two nodes alike."""
    row, col = np.mgrid[:rows, :cols] * SPACING
    away = ((row - 0.05) ** 2 + (col - 0.11) ** 2) / 0.05**2
    return grid_surface(np.stack([height_m * np.exp(-away), -row, -col * 1.1 - 0.2 * row], axis=2))
