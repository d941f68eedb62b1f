"""Vectors whose components stand first, (3, ...): numpy then works on whole rows of frames, several times as fast."""

from __future__ import annotations

import numpy as np


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(...) of vectors (3, ...)."""
    product: np.ndarray = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3, ...)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def length(vector: np.ndarray) -> np.ndarray:
    """(...) of vectors (3, ...)."""
    return np.sqrt(dot(vector, vector))


def unit(vector: np.ndarray) -> np.ndarray:
    """(3, ...) of length one; NaN where the vector has no length."""
    long = length(vector)
    return vector / np.where(long > 0, long, np.nan)


def square_to(vector: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """(3, ...) unit vector: what of ``vector`` is at right angles to the unit vector ``axis``."""
    return unit(vector - dot(vector, axis) * axis)


def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(...) angle between vectors, exact for small ones too; NaN where one has no length."""
    across, along = length(cross(a, b)), dot(a, b)
    return np.where((across == 0) & (along == 0), np.nan, np.arctan2(across, along))


def arcsin(sine: np.ndarray) -> np.ndarray:
    """(...) of numbers that rounding may have put beyond one."""
    angle: np.ndarray = np.arcsin(np.clip(sine, -1.0, 1.0))
    return angle
