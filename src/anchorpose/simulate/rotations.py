"""Rotations, batched over any leading axes. Axes X forward, Y up, Z right; radians."""

from __future__ import annotations

import numpy as np

FORWARD, UP, RIGHT = np.eye(3)


def turn_about(vectors: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3), axis times angle, to matrices (..., 3, 3) (Rodrigues' formula)."""
    vectors = np.asarray(vectors, dtype=np.float64)
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    axis = vectors / np.where(angle[..., 0] > 0, angle[..., 0], 1.0)
    cross = np.zeros((*vectors.shape[:-1], 3, 3))
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -axis[..., 2], axis[..., 1], -axis[..., 0]
    cross -= np.swapaxes(cross, -1, -2)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def turn_by(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotation by ``angle`` (...) about one unit ``axis`` (3,): (..., 3, 3)."""
    return turn_about(np.asarray(angle)[..., None] * axis)


def rotation_vector(matrices: np.ndarray) -> np.ndarray:
    """Matrices (n, 3, 3) to rotation vectors (n, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(matrices).as_rotvec()


def orthonormal_frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Columns: ``first``, ``second`` made perpendicular to it, and their cross product; (..., 3) to (..., 3, 3)."""
    first = unit(first)
    second = unit(second - (second * first).sum(axis=-1, keepdims=True) * first)
    return np.stack([first, second, np.cross(first, second)], axis=-1)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) of length one; zero vectors are a caller's mistake and become NaN."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def apply(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """``matrices @ vectors`` for (..., 3, 3) and (..., 3)."""
    return np.einsum("...ij,...j->...i", matrices, vectors)
