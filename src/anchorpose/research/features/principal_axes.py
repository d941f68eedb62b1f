"""The axes of a symmetric 3 x 3 matrix, for kernels that need them thousands of times a frame."""

from __future__ import annotations

import numpy as np
from numba import njit

SWEEPS = 12  # Jacobi's rotations converge quadratically: six reach the last digit


@njit(cache=True, error_model="numpy")
def principal_axes(matrix: np.ndarray, axes: np.ndarray) -> None:
    """Fills axes (3, 3) float64, one a row: those of the largest, the middle and the smallest eigenvalue.

    matrix (3, 3) float64 symmetric, is overwritten: its diagonal becomes the eigenvalues in that order. The axes have
    unit length; their signs mean nothing. Source: Jacobi's cyclic rotations (Golub, Van Loan, Section 8.5).
    """
    axes[:] = 0.0
    axes[0, 0] = axes[1, 1] = axes[2, 2] = 1.0
    for _ in range(SWEEPS):
        off = matrix[0, 1] ** 2 + matrix[0, 2] ** 2 + matrix[1, 2] ** 2
        if off <= 1e-34 * (matrix[0, 0] ** 2 + matrix[1, 1] ** 2 + matrix[2, 2] ** 2):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if matrix[p, q] != 0.0:
                    _rotate(matrix, axes, p, q)
    for p in range(2):
        for q in range(2 - p):
            if matrix[q, q] < matrix[q + 1, q + 1]:
                matrix[q, q], matrix[q + 1, q + 1] = matrix[q + 1, q + 1], matrix[q, q]
                for column in range(3):
                    axes[q, column], axes[q + 1, column] = axes[q + 1, column], axes[q, column]


@njit(cache=True, error_model="numpy")
def _rotate(matrix: np.ndarray, axes: np.ndarray, p: int, q: int) -> None:
    """One rotation in the plane of p and q that makes their entry zero."""
    lean = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
    tangent = (1.0 if lean >= 0.0 else -1.0) / (abs(lean) + np.sqrt(lean * lean + 1.0))
    cosine = 1.0 / np.sqrt(tangent * tangent + 1.0)
    sine, entry, other = tangent * cosine, matrix[p, q], 3 - p - q
    matrix[p, p] -= tangent * entry
    matrix[q, q] += tangent * entry
    matrix[p, q] = matrix[q, p] = 0.0
    to_p, to_q = matrix[other, p], matrix[other, q]
    matrix[other, p] = matrix[p, other] = cosine * to_p - sine * to_q
    matrix[other, q] = matrix[q, other] = sine * to_p + cosine * to_q
    for column in range(3):
        to_p, to_q = axes[p, column], axes[q, column]
        axes[p, column], axes[q, column] = cosine * to_p - sine * to_q, sine * to_p + cosine * to_q
