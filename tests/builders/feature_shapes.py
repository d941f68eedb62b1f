"""A closed surface without symmetry, for the tests of the local descriptors and for their reference numbers."""

from pathlib import Path

import numpy as np


def bumpy_torus(rows: int = 36, cols: int = 20, seed: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """points_m (rows * cols, 3) float32, their outward normals float32 and triangles (f, 3) int32, half a metre wide.

    Nodes lie irregularly, so that no distance falls on the edge of a ball and no angle on that of a bin by design.
    """
    random = np.random.default_rng(seed)
    row, col = np.mgrid[:rows, :cols].astype(np.float64)
    around = 2 * np.pi * (row + random.uniform(-0.25, 0.25, row.shape)) / rows
    across = 2 * np.pi * (col + random.uniform(-0.25, 0.25, col.shape)) / cols
    step = 1e-5
    along = _place(around + step, across) - _place(around - step, across)
    aside = _place(around, across + step) - _place(around, across - step)
    normals = np.cross(along, aside)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    index = np.arange(rows * cols).reshape(rows, cols)
    below, right = np.roll(index, -1, axis=0), np.roll(index, -1, axis=1)
    corner = np.roll(below, -1, axis=1)
    triangles = np.concatenate([np.stack([index, below, corner], axis=2), np.stack([index, corner, right], axis=2)])
    points = _place(around, across).reshape(-1, 3).astype(np.float32)
    return points, normals.reshape(-1, 3).astype(np.float32), triangles.reshape(-1, 3).astype(np.int32)


def _place(around: np.ndarray, across: np.ndarray) -> np.ndarray:
    """(..., 3) metres: a torus of 0.2 m and 0.1 m whose tube has bumps of 2 cm and is pressed on one side."""
    tube = 0.1 + 0.02 * np.sin(3 * around + 2 * across) + 0.015 * np.cos(2 * around - across + 0.7)
    wide = 0.2 + 0.02 * np.sin(around + 0.4) + tube * np.cos(across)
    return np.stack(
        [wide * np.cos(around), wide * np.sin(around), (1 + 0.3 * np.cos(around)) * tube * np.sin(across)], 2
    )


def rigid_motion(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A rotation (3, 3) and a shift (3,) in metres, both float64, drawn at random."""
    random = np.random.default_rng(seed)
    q, r = np.linalg.qr(random.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q), random.uniform(-1.0, 1.0, 3)


def pcl_reference() -> dict[str, np.ndarray]:
    """The fixed cloud and what PCL says of some of its points: pcl_reference/make_reference.py."""
    with np.load(Path(__file__).parents[1] / "pcl_reference" / "reference.npz") as file:
        return {name: file[name] for name in file.files}
