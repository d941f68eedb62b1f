"""Build shapes that are not made of boxes and cylinders: curtains, coats, quilts, pillows and leaves, as open triangle
meshes.
"""

from __future__ import annotations

import numpy as np


def grid_triangles(points_m: np.ndarray) -> np.ndarray:
    """Return (2 (r - 1) (c - 1), 3, 3) triangles of a sheet whose points are given row by row (r, c, 3)."""
    a, b, c, d = points_m[:-1, :-1], points_m[:-1, 1:], points_m[1:, 1:], points_m[1:, :-1]
    return np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)


def folded_curtain(rng: np.random.Generator, wide_m: float, high_m: float) -> np.ndarray:
    """Return triangles (n, 3, 3) of a curtain along Z that hangs to the floor in folds of 3 to 8 cm, deeper towards the
    hem.
    """
    across, down = np.linspace(-0.5, 0.5, max(24, int(40 * wide_m))), np.linspace(0.0, 1.0, 8)
    folds, phase = wide_m / rng.uniform(0.12, 0.3), rng.uniform(0.0, 6.0)
    depth_m = rng.uniform(0.03, 0.08) * (0.5 + 0.5 * down[:, None])
    wave = np.sin(2.0 * np.pi * folds * across + phase + 0.6 * np.sin(9.0 * across + phase) + 0.4 * down[:, None])
    x = depth_m * wave
    y = np.broadcast_to(0.02 + (high_m - 0.02) * (1.0 - down[:, None]), x.shape)
    return grid_triangles(np.stack([x, y, np.broadcast_to(wide_m * across, x.shape)], axis=2))


def hanging_coat(rng: np.random.Generator, top_m: float, way: float) -> np.ndarray:
    """Return triangles (n, 3, 3) of a coat that hangs on a pole at x = z = 0: a tube that widens downwards in folds.
    way: direction from the pole to the coat, radians from +X towards +Z.
    """
    around, down = np.linspace(0.0, 2.0 * np.pi, 25), np.linspace(0.0, 1.0, 9)[:, None]
    long_m, folds = rng.uniform(0.7, 1.1), int(rng.integers(4, 8))
    radius = (0.05 + 0.13 * np.sqrt(down)) * (1.0 + 0.18 * down * np.sin(folds * around + rng.uniform(0.0, 6.0)))
    x, z = 0.14 + 0.7 * radius * np.cos(around), 1.2 * radius * np.sin(around)
    y = np.broadcast_to(top_m - long_m * down, x.shape)
    points = np.stack([np.cos(way) * x - np.sin(way) * z, y, np.sin(way) * x + np.cos(way) * z], axis=2)
    return grid_triangles(points)


def crumpled_sheet(rng: np.random.Generator, wide_m: float, long_m: float) -> np.ndarray:
    """Return triangles (n, 3, 3) of a quilt in the plane of X and Z, with lumps of up to 8 cm and hanging sides."""
    x, z = np.meshgrid(np.linspace(-0.55, 0.55, 16), np.linspace(-0.5, 0.5, 20))
    y = np.zeros_like(x)
    for _ in range(6):
        kx, kz = rng.uniform(-9.0, 9.0, 2)
        y += rng.uniform(0.0, 0.02) * np.sin(kx * x + kz * z + rng.uniform(0.0, 6.0))
    y += 0.03 - 0.25 * (np.abs(x) > 0.5)
    return grid_triangles(np.stack([wide_m * x, y, long_m * z], axis=2))


def pillow(rng: np.random.Generator) -> np.ndarray:
    """Return the triangles (n, 3, 3) of a flat ellipsoid, 0.6 by 0.4 m, on the plane y = 0."""
    u, v = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 17), np.linspace(0.0, np.pi, 9))
    size = np.array([0.3, rng.uniform(0.06, 0.1), 0.2])
    ball = np.stack([np.cos(u) * np.sin(v), np.cos(v) + 1.0, np.sin(u) * np.sin(v)], axis=2)
    return grid_triangles(ball * size)


def leaves(rng: np.random.Generator, low_m: float, high_m: float) -> np.ndarray:
    """Return triangles (n, 3, 3) of narrow leaves that grow outwards and upwards from a stem on the Y axis and bend
    down.
    """
    count = int(rng.integers(25, 60))
    found = []
    for way, start_m, long_m, rise in zip(
        rng.uniform(0.0, 2.0 * np.pi, count),
        rng.uniform(low_m, high_m, count),
        rng.uniform(0.15, 0.45, count),
        rng.uniform(0.0, 0.8, count),
        strict=True,
    ):
        along = np.linspace(0.0, 1.0, 5)[:, None]
        out, side = np.array([np.cos(way), 0.0, np.sin(way)]), np.array([-np.sin(way), 0.0, np.cos(way)])
        spine = long_m * (along * out + (rise * along - 0.7 * along**2) * np.array([0.0, 1.0, 0.0]))
        half = 0.035 * np.sin(np.pi * np.clip(along, 0.05, 0.98)) * side
        leaf = np.stack([spine - half, spine + half], axis=1) + np.array([0.0, start_m, 0.0])
        found.append(grid_triangles(leaf))
    return np.maximum(np.concatenate(found), [-np.inf, 0.01, -np.inf])
