"""Rotation vectors and matrices of a few bones at once, of which scipy's Rotation would check each at every call."""

from __future__ import annotations

import numpy as np
from numba import njit


def turns_of(vectors: np.ndarray) -> np.ndarray:
    """(m, 3, 3) rotation matrices of rotation vectors (m, 3), radians."""
    matrices = np.empty((len(vectors), 3, 3))
    _turns(np.ascontiguousarray(vectors, np.float64), matrices)
    return matrices


def vectors_of(matrices: np.ndarray) -> np.ndarray:
    """(m, 3) rotation vectors, no longer than pi, of rotation matrices (m, 3, 3)."""
    vectors = np.empty((len(matrices), 3))
    _vectors(np.ascontiguousarray(matrices, np.float64), vectors)
    return vectors


@njit(cache=True)
def _turns(vectors: np.ndarray, matrices: np.ndarray) -> None:
    """Rodrigues' formula."""
    for m in range(len(vectors)):
        x, y, z = vectors[m, 0], vectors[m, 1], vectors[m, 2]
        squared = x * x + y * y + z * z
        angle = np.sqrt(squared)
        if angle < 1e-4:  # the series, where the quotients lose their digits
            sine, versine = 1.0 - squared / 6.0, 0.5 - squared / 24.0
        else:
            sine, versine = np.sin(angle) / angle, (1.0 - np.cos(angle)) / squared
        matrices[m, 0, 0], matrices[m, 0, 1] = 1.0 - versine * (y * y + z * z), versine * x * y - sine * z
        matrices[m, 0, 2], matrices[m, 1, 0] = versine * x * z + sine * y, versine * x * y + sine * z
        matrices[m, 1, 1], matrices[m, 1, 2] = 1.0 - versine * (x * x + z * z), versine * y * z - sine * x
        matrices[m, 2, 0], matrices[m, 2, 1] = versine * x * z - sine * y, versine * y * z + sine * x
        matrices[m, 2, 2] = 1.0 - versine * (x * x + y * y)


@njit(cache=True)
def _vectors(matrices: np.ndarray, vectors: np.ndarray) -> None:
    """The logarithm by way of the unit quaternion, its largest part first (Shepperd 1978, doi:10.2514/3.55767b)."""
    q = np.empty(4)
    for m in range(len(matrices)):
        r = matrices[m]
        trace = r[0, 0] + r[1, 1] + r[2, 2]
        largest, value = 3, trace
        for axis in range(3):
            if r[axis, axis] > value:
                largest, value = axis, r[axis, axis]
        if largest == 3:
            q[3] = 1.0 + trace
            q[0], q[1], q[2] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
        else:
            i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
            q[i] = 1.0 - trace + 2.0 * r[i, i]
            q[j], q[k] = r[j, i] + r[i, j], r[k, i] + r[i, k]
            q[3] = r[k, j] - r[j, k]
        length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        length = -length if q[3] < 0.0 else length
        for axis in range(4):
            q[axis] /= length
        sine = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
        scale = 2.0 if sine < 1e-9 else 2.0 * np.arctan2(sine, q[3]) / sine
        for axis in range(3):
            vectors[m, axis] = scale * q[axis]


@njit(cache=True)
def inverse_left_jacobian(vector: np.ndarray, change: np.ndarray) -> None:
    """``log(exp(d) exp(w)) = w + J d`` to first order (Barfoot 2017, doi:10.1017/9781316671528)."""
    squared = vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2
    angle = np.sqrt(squared)
    factor = 1.0 / 12.0 if angle < 1e-6 else (1.0 - angle / 2.0 / np.tan(angle / 2.0)) / squared
    for i in range(3):
        for j in range(3):  # the square of the cross product's matrix is w w^T - |w|^2
            change[i, j] = factor * vector[i] * vector[j]
        change[i, i] += 1.0 - factor * squared
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        change[j, k] += vector[i] / 2.0
        change[k, j] -= vector[i] / 2.0
