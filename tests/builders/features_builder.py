"""Surfaces with exact normals, moved and renumbered, for the tests of descriptors."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from surface_builder import grid_surface

from anchorpose.surface.surface import Surface


def height_field(height: Callable, side: int = 41, spacing_m: float = 0.015, turn_rad: float = 0.0) -> Surface:
    """A sheet around X = 0 with the height along X over (left, up), turned about X; node side**2 // 2 is the middle."""
    row, col = (np.mgrid[:side, :side] - side // 2) * spacing_m
    up, left = -row, -col

    def turned(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return height(np.cos(turn_rad) * a + np.sin(turn_rad) * b, np.cos(turn_rad) * b - np.sin(turn_rad) * a)

    tiny = 1e-5
    by_left = (turned(left + tiny, up) - turned(left - tiny, up)) / (2 * tiny)
    by_up = (turned(left, up + tiny) - turned(left, up - tiny)) / (2 * tiny)
    normals = np.stack([np.ones_like(by_up), -by_up, -by_left], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    surface = grid_surface(np.stack([turned(left, up), up, left], axis=2))
    return replace(surface, normals=normals.reshape(-1, 3).astype(np.float32))


def lump(left: np.ndarray, up: np.ndarray) -> np.ndarray:
    """A nose on a slope of its own: no symmetry, some 3 cm high."""
    nose = 0.03 * np.exp(-(((left - 0.02) / 0.05) ** 2) - ((up + 0.01) / 0.09) ** 2)
    return nose + 0.015 * np.exp(-(((left + 0.06) / 0.03) ** 2) - ((up - 0.05) / 0.04) ** 2)


def saddle(left: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Something else than the lump."""
    return 0.02 * np.sin(left / 0.03) * np.cos(up / 0.05)


def rolled_sheet(radius_m: float = 0.05, side: int = 25, spacing_m: float = 0.012) -> Surface:
    """A sheet rolled most of the way around an upright axis, so that some of it is behind its own middle."""
    row, col = (np.mgrid[:side, :side] - side // 2) * spacing_m
    normals = np.stack([np.cos(col / radius_m), np.zeros_like(row), -np.sin(col / radius_m)], axis=2)
    surface = grid_surface(radius_m * normals - row[:, :, None] * [0.0, 1.0, 0.0])
    return replace(surface, normals=normals.reshape(-1, 3).astype(np.float32))


def moved(surface: Surface, rotation: Rotation, shift_m: np.ndarray) -> Surface:
    """The surface somewhere else."""
    points = rotation.apply(surface.points_m.astype(np.float64)) + shift_m
    normals = rotation.apply(surface.normals.astype(np.float64))
    return replace(surface, points_m=points.astype(np.float32), normals=normals.astype(np.float32))


def somewhere(seed: int) -> tuple[Rotation, np.ndarray]:
    rng = np.random.default_rng(seed)
    return Rotation.random(random_state=seed), rng.normal(size=3)


def renumbered(surface: Surface, order: np.ndarray) -> Surface:
    """The surface without links whose node k is node order[k] of the given one."""
    new = np.full(len(surface) + 1, -1, np.int32)
    new[order] = np.arange(len(order))
    return replace(
        surface,
        points_m=surface.points_m[order],
        normals=surface.normals[order],
        ring=new[surface.ring[order]],
        pixel=surface.pixel[order],
    )


def rough(surface: Surface, seed: int, noise_m: float = 0.001, noise_rad: float = 0.03) -> Surface:
    """The surface with errors in its positions and normals, so that nothing about it is even."""
    rng = np.random.default_rng(seed)
    normals = surface.normals + noise_rad * rng.normal(size=surface.normals.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = surface.points_m + noise_m * rng.normal(size=surface.points_m.shape)
    return replace(surface, points_m=points.astype(np.float32), normals=normals.astype(np.float32))
