"""Compute rotations and directions: rotation vectors (axis times angle, radians), matrices, quaternions, unit vectors.

Functions that tracking calls very often, each time for a few bones, are compiled here. scipy's Rotation is not used for
them, since it checks its input at every call, which takes time.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from anchorpose.errors import DegenerateGeometry

FORWARD, UP, RIGHT = np.eye(3)
"""Unit vectors (3,) along the world's axes x, y and z, or along the axes of a body's own frame."""

# maximum ratio of the second to the first singular value of the covariance of two sets of points, for the points to
# count as collinear
COLLINEAR_RATIO: Final = 1e-3
# m2, (1 micrometre)²; points also count as collinear if the second singular value of that covariance is at most this,
# whatever the ratio of the singular values is
ONE_PLACE_M2: Final = 1e-12


def unit(vectors: np.ndarray, axis: int = -1) -> np.ndarray:
    """Return the vectors, scaled to length one. axis: the axis of the array along which the components of a vector lie.
    The result is NaN where a vector has length zero.
    """
    length = np.linalg.norm(vectors, axis=axis, keepdims=True)
    return vectors / np.where(length > 0, length, np.nan)


def orthonormal_frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return rotation matrices (..., 3, 3) from vectors (..., 3). The unit columns of each matrix are ``first``,
    ``second`` made perpendicular to ``first``, and the cross product of both.
    """
    first = unit(first)
    second = unit(second - (second * first).sum(axis=-1, keepdims=True) * first)
    return np.stack([first, second, np.cross(first, second)], axis=-1)


def rotate(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return ``matrices @ vectors`` for (..., 3, 3) and (..., 3)."""
    return np.einsum("...ij,...j->...i", matrices, vectors)


def rigid(turn: np.ndarray, shift_m: np.ndarray) -> np.ndarray:
    """Return the transform (4, 4) that rotates by ``turn`` (3, 3), then shifts by ``shift_m`` (3,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn, shift_m
    return T


def turns(vectors: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (..., 3, 3) of rotation vectors (..., 3), computed by numpy and not by compiled
    code.

    Simulations use this function, so that simulated values are always the same to the last digit; the compiled
    ``rotation_matrices`` may differ in this digit.
    """
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    axis = vectors / np.where(angle[..., 0] > 0, angle[..., 0], 1.0)
    cross = np.zeros((*vectors.shape[:-1], 3, 3))
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -axis[..., 2], axis[..., 1], -axis[..., 0]
    cross -= np.swapaxes(cross, -1, -2)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def turns_about(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (..., 3, 3) for angles (...), radians, about one unit ``axis`` (3,)."""
    return turns(np.asarray(angle)[..., None] * axis)


def rotation_about_y(angle_rad: float) -> np.ndarray:
    """Return the right-handed rotation (3, 3) about Y."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])


def rotation_matrices(vectors: np.ndarray) -> np.ndarray:
    """Return (m, 3, 3) rotation matrices of rotation vectors (m, 3)."""
    matrices = np.empty((len(vectors), 3, 3))
    _matrices(np.ascontiguousarray(vectors, np.float64), matrices)
    return matrices


def rotation_vectors(matrices: np.ndarray) -> np.ndarray:
    """Return (m, 3) rotation vectors, of length at most pi, of rotation matrices (m, 3, 3)."""
    vectors = np.empty((len(matrices), 3))
    _vectors(np.ascontiguousarray(matrices, np.float64), vectors)
    return vectors


def quaternions(matrices: np.ndarray) -> np.ndarray:
    """Return (m, 4) unit quaternions w, x, y, z, w not negative, of rotation matrices (m, 3, 3)."""
    vectors = rotation_vectors(matrices)
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.hstack([np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors])


@njit(cache=True, nogil=True)
def _matrices(vectors: np.ndarray, matrices: np.ndarray) -> None:
    """Write the rotation matrices of rotation vectors (m, 3) to ``matrices`` (m, 3, 3), by Rodrigues' formula."""
    for m in range(len(vectors)):
        x, y, z = vectors[m, 0], vectors[m, 1], vectors[m, 2]
        squared = x * x + y * y + z * z
        angle = np.sqrt(squared)
        if angle < 1e-4:  # at small angles, a Taylor series is used, since the quotients below lose digits there
            sine, versine = 1.0 - squared / 6.0, 0.5 - squared / 24.0
        else:
            sine, versine = np.sin(angle) / angle, (1.0 - np.cos(angle)) / squared
        matrices[m, 0, 0], matrices[m, 0, 1] = 1.0 - versine * (y * y + z * z), versine * x * y - sine * z
        matrices[m, 0, 2], matrices[m, 1, 0] = versine * x * z + sine * y, versine * x * y + sine * z
        matrices[m, 1, 1], matrices[m, 1, 2] = 1.0 - versine * (x * x + z * z), versine * y * z - sine * x
        matrices[m, 2, 0], matrices[m, 2, 1] = versine * x * z - sine * y, versine * y * z + sine * x
        matrices[m, 2, 2] = 1.0 - versine * (x * x + y * y)


@njit(cache=True, nogil=True)
def _vectors(matrices: np.ndarray, vectors: np.ndarray) -> None:
    """Write the rotation vectors of ``matrices`` (m, 3, 3) to ``vectors`` (m, 3). They are computed by way of unit
    quaternions; the largest component of each quaternion is computed first, which keeps the result precise (Shepperd
    1978, doi:10.2514/3.55767b).
    """
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


@njit(cache=True, nogil=True)
def inverse_left_jacobian(vector: np.ndarray, change: np.ndarray) -> None:
    """Write to ``change`` (3, 3) the inverse left Jacobian J at the rotation vector w (``vector``): a small rotation d,
    applied after w, changes w by J d, that is, ``log(exp(d) exp(w)) = w + J d`` to first order (Barfoot 2017,
    doi:10.1017/9781316671528).
    """
    squared = vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2
    angle = np.sqrt(squared)
    factor = 1.0 / 12.0 if angle < 1e-6 else (1.0 - angle / 2.0 / np.tan(angle / 2.0)) / squared
    for i in range(3):
        for j in range(3):  # the square of the matrix of the cross product with w is w w^T - |w|^2 I
            change[i, j] = factor * vector[i] * vector[j]
        change[i, i] += 1.0 - factor * squared
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        change[j, k] += vector[i] / 2.0
        change[k, j] -= vector[i] / 2.0


def fit_rigid_transform(source_m: np.ndarray, target_m: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """Return the rigid motion that best maps source_m onto target_m, by least squares.

    source_m, target_m : (n, 3) float64, metres. Row i of ``source_m`` corresponds to row i of ``target_m``. weight
    (n,): the weight of each row, not negative; None for equal weights. Returns T_target_source : (4, 4). Raises
    DegenerateGeometry when the points are collinear or fewer than three. Source: Arun et al. 1987
    (doi:10.1109/TPAMI.1987.4767965), reflections excluded.
    """
    if len(source_m) < 3:
        raise DegenerateGeometry(f"{len(source_m)} points do not determine a rigid motion")
    share = np.full(len(source_m), 1.0 / len(source_m)) if weight is None else weight / weight.sum()
    source_mean, target_mean = share @ source_m, share @ target_m
    u, spread, vt = np.linalg.svd((share[:, None] * (target_m - target_mean)).T @ (source_m - source_mean))
    if spread[1] <= max(COLLINEAR_RATIO * spread[0], ONE_PLACE_M2):
        raise DegenerateGeometry(f"{len(source_m)} points are collinear; rotation undefined")
    handedness = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    turn = u @ handedness @ vt
    return rigid(turn, target_mean - turn @ source_mean)
