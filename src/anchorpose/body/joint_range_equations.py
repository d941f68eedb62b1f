"""What the joints' range and the hinges' limits say of a pose, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.body.rotations import inverse_left_jacobian


@njit(cache=True)
def range_equations(
    vectors: np.ndarray, mean: np.ndarray, whiten: np.ndarray, hinge: np.ndarray, hinge_limit: np.ndarray,
    hinge_limit_sigma: float,
) -> tuple[np.ndarray, np.ndarray, float]:  # fmt: skip
    """Hessian, gradient and cost: ``|whiten (vector - mean)|^2`` of each moving bone, and the square past its limit.

    vectors (m, 3): the bones' rotation vectors; the rest as in ``JointRange``, radians.
    """
    size = 3 * len(vectors) + 3
    hessian, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
    change, slope, bend = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for m in range(len(vectors)):
        inverse_left_jacobian(vectors[m], change)
        past = hinge_limit[m]
        for j in range(3):
            past -= vectors[m, j] * hinge[m, j]
        past = max(past, 0.0) / hinge_limit_sigma
        cost += past * past
        for i in range(3):
            deviation, bend[i] = 0.0, 0.0
            for j in range(3):
                deviation += whiten[m, i, j] * (vectors[m, j] - mean[m, j])
                bend[i] -= hinge[m, j] * change[j, i] / hinge_limit_sigma
                slope[i, j] = 0.0
                for k in range(3):
                    slope[i, j] += whiten[m, i, k] * change[k, j]
            cost += deviation * deviation
            for j in range(3):
                gradient[3 * m + j] += slope[i, j] * deviation
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    hessian[3 * m + i, 3 * m + j] += slope[k, i] * slope[k, j]
                if past > 0.0:
                    hessian[3 * m + i, 3 * m + j] += bend[i] * bend[j]
            gradient[3 * m + i] += bend[i] * past
    return hessian, gradient, cost
