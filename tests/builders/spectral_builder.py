"""Shapes whose spectrum is known, and changes of a surface that no intrinsic feature may notice."""

from dataclasses import replace

import numpy as np
from scipy.spatial import ConvexHull
from surface_builder import grid_surface

from anchorpose.surface.surface import Surface


def scaled(surface: Surface, size: float) -> Surface:
    return replace(surface, points_m=(surface.points_m * size).astype(np.float32))


def shuffled(surface: Surface, order: np.ndarray) -> Surface:
    """Node k of the result is node order[k] of a surface without links."""
    number = np.empty(len(order) + 1, np.int32)
    number[order], number[-1] = np.arange(len(order)), -1
    return replace(
        surface, points_m=surface.points_m[order], ring=number[surface.ring[order]], pixel=surface.pixel[order]
    )


def flag(spacing_m: float = 0.02, turn_rad: float = 0.0) -> Surface:
    """A sheet with two unlike notches and two unlike tails, no symmetry; each column bent by ``turn_rad``.

    A bent column keeps the length of its cells, so all turns are isometric."""
    row, col = np.mgrid[:26, :40]
    present = ~((row < 9) & (col > 22)) & ~((row > 17) & (col < 13)) & ~((row > 21) & (col > 33))
    heading = turn_rad * np.arange(39)
    x = np.concatenate([[0.0], np.cumsum(np.sin(heading))])
    z = np.concatenate([[0.0], np.cumsum(np.cos(heading))])
    return grid_surface(np.stack([x[col], -row.astype(float), -z[col]], axis=2) * spacing_m, present)


def rough_sheet(seed: int, rows: int = 24, cols: int = 30) -> Surface:
    """A sheet with slivers, holes, an outline in shreds and several pieces: what depth cameras make of a body."""
    random = np.random.default_rng(seed)
    row, col = np.mgrid[:rows, :cols] * 0.013
    points = np.stack([0.05 * np.sin(9 * col) + random.normal(0, 0.006, row.shape), -row, -col], axis=2)
    points[random.random(row.shape) < 0.1, 0] += 0.06  # an edge five times as long as its neighbours
    present = random.random(row.shape) > 0.25
    return grid_surface(points, present)


def ball(count: int = 1500, radius_m: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and outward triangles of a sphere, spread evenly along a spiral; its hull is Delaunay on the sphere."""
    k = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - height**2)
    points = radius_m * np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
    return points, ConvexHull(points).simplices.astype(np.int64)
