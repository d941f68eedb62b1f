"""Sheets with convex holes that are smooth, and closed cylinders, for the tests of occlusion."""

from dataclasses import dataclass, replace

import numpy as np
from surface_builder import flat_grid, grid_surface

from anchorpose.surface.surface import Surface

SPACING = 0.013  # every second pixel of a Kinect v2 at 2.4 m


@dataclass(frozen=True, slots=True, eq=False)
class Pierced:
    """A whole surface and the nodes of a convex hole in it; flat_m (n, 2): where each node lies on the flat sheet."""

    whole: Surface
    hidden: np.ndarray
    flat_m: np.ndarray


def elliptic_hole(
    half: int = 15, hole: int = 5, stretch: float = 1.0, turn_rad: float = 0.0, ball_m: float | None = None
) -> Pierced:
    """A sheet of 2 half + 1 nodes each way whose rings of squares are bent into circles near the middle.

    The hole's boundary is the ring of 8 ``hole`` nodes on a circle, stretched to an ellipse. ball_m: lay the sheet on
    a ball of that radius, distances from the middle kept; the hole is a spherical cap then (stretch 1).
    """
    row, col = np.mgrid[-half : half + 1, -half : half + 1].astype(np.float64)
    square, round_ = np.maximum(np.abs(row), np.abs(col)), np.hypot(row, col)
    bend = np.clip((half - square) / (half - hole), 0.0, 1.0)  # 1 up to the hole, 0 at the rim
    scale = (1.0 - bend) + bend * square / np.maximum(round_, 1e-9)
    flat = np.stack([col * scale, row * scale], axis=2) * SPACING
    flat = flat * [stretch, 1.0]
    turn = np.array([[np.cos(turn_rad), -np.sin(turn_rad)], [np.sin(turn_rad), np.cos(turn_rad)]])
    flat = flat @ turn.T
    points = np.concatenate([np.zeros((*row.shape, 1)), flat], axis=2)
    if ball_m is not None:
        away = np.linalg.norm(flat, axis=2, keepdims=True)
        sideways = flat / np.maximum(away, 1e-12) * np.sin(away / ball_m)
        points = ball_m * np.concatenate([np.cos(away / ball_m), sideways], axis=2)
    whole = grid_surface(points)
    if ball_m is not None:
        whole = replace(whole, normals=whole.points_m / np.float32(ball_m))
    return Pierced(whole, (square < hole).ravel(), flat.reshape(-1, 2))


def lattice_hole(rows: int, cols: int, inside) -> Pierced:
    """A flat sheet; inside(row, col) says which nodes the hole takes, counted from the middle node."""
    surface = flat_grid(rows, cols, SPACING)
    row, col = np.mgrid[:rows, :cols]
    hidden = inside(row - rows // 2, col - cols // 2).ravel()
    return Pierced(surface, hidden, np.stack([col, row], axis=2).reshape(-1, 2) * SPACING)


def cylinder(around: int, rows: int, spacing_m: float = SPACING) -> Surface:
    """A closed tube of ``around`` columns; unrolled, each cell is a square of ``spacing_m``."""
    radius = spacing_m / (2.0 * np.sin(np.pi / around))
    angle = 2.0 * np.pi * np.arange(around) / around
    points = np.empty((rows, around, 3))
    points[..., 0], points[..., 2] = radius * np.cos(angle), radius * np.sin(angle)
    points[..., 1] = -spacing_m * np.arange(rows)[:, None]
    wide = grid_surface(np.concatenate([points[:, -1:], points, points[:, :1]], axis=1))
    grid = np.arange(rows * (around + 2)).reshape(rows, around + 2)
    number = np.full(len(wide) + 1, -1, np.int64)
    number[grid[:, 1:-1].ravel()] = np.arange(rows * around)
    number[grid[:, 0]], number[grid[:, -1]] = number[grid[:, -2]], number[grid[:, 1]]
    inner = grid[:, 1:-1].ravel()
    return Surface(
        points_m=wide.points_m[inner],
        normals=(points * [1, 0, 1] / radius).reshape(-1, 3).astype(np.float32),
        ring=number[wide.ring[inner]].astype(np.int32),
        link_start=np.zeros(len(inner) + 1, np.int32),
        link_node=np.zeros(0, np.int32),
        link_length_m=np.zeros(0, np.float32),
        camera=wide.camera[inner],
        pixel=wide.pixel[inner],
        skin=wide.skin[inner],
    )
