"""Compute SHOT's repeatable local frame: principal axes of the neighbours, each pointing to the side with more
neighbours.

Source: Tombari, Salti, Di Stefano 2010 (doi:10.1007/978-3-642-15558-1_26), Section 3, as PCL 1.13 implements it.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.research.features.neighbours import Neighbours, as_points

FEWEST = 5  # minimum number of neighbours, as in the authors' program; with fewer, the axes would be noise
SWEEPS = 12  # maximum number of sweeps of Jacobi rotations; convergence is quadratic, so six are enough for all digits


def local_frames(points_m: np.ndarray, neighbours: Neighbours, normals: np.ndarray | None = None) -> np.ndarray:
    """Return (n, 3, 3) float32: rows x, y, z of the right-handed frame of each node; NaN where undefined.

    points_m (n, 3). x lies along the widest spread of the neighbours, and z along the narrowest spread, across the
    surface. Each of these axes points to the side with more neighbours. If both sides have the same number, only five
    neighbours count: the middle five when sorted by distance. normals (n, 3): if given, z points to the side of the
    node's normal instead; on a nearly flat surface, noise decides which side has more neighbours. A frame is undefined
    if the node has fewer than five neighbours at other positions, or no normal although normals are given.
    """
    points = as_points(points_m, "points_m")
    unit = as_points(normals, "normals") if normals is not None else np.empty((0, 3), np.float32)
    return _frames(points, neighbours, normals is not None, unit)


def as_frames(frames: np.ndarray, count: int) -> np.ndarray:
    """Return frames as a contiguous array (k, 3, 3) float32; raises ValueError for another shape."""
    frames = np.ascontiguousarray(frames, np.float32)
    if frames.shape != (count, 3, 3):
        raise ValueError(f"frames must have shape ({count}, 3, 3), got {frames.shape}")
    return frames


@njit(cache=True, error_model="numpy")
def _frames(points: np.ndarray, neighbours: Neighbours, by_normal: bool, normals: np.ndarray) -> np.ndarray:
    start, node = neighbours.start, neighbours.node
    distance2, radius = neighbours.distance2_m2, neighbours.radius_m
    frames = np.full((len(points), 3, 3), np.nan, np.float32)
    spread, axes = np.empty((3, 3)), np.empty((3, 3))
    for own in range(len(points)):
        row = slice(start[own], start[own + 1])
        if _spread(points, own, node[row], distance2[row], radius, spread) < FEWEST:
            continue
        principal_axes(spread, axes)
        x, z = axes[0], axes[2]
        if _points_away(points, own, node[row], distance2[row], x):
            x[:] = -x
        if by_normal:
            along = z[0] * normals[own, 0] + z[1] * normals[own, 1] + z[2] * normals[own, 2]
            if not np.isfinite(along):
                continue
            if along < 0.0:
                z[:] = -z
        elif _points_away(points, own, node[row], distance2[row], z):
            z[:] = -z
        frames[own, 0], frames[own, 2] = x, z
        frames[own, 1, 0] = z[1] * x[2] - z[2] * x[1]
        frames[own, 1, 1] = z[2] * x[0] - z[0] * x[2]
        frames[own, 1, 2] = z[0] * x[1] - z[1] * x[0]
    return frames


@njit(cache=True, error_model="numpy")
def _spread(
    points: np.ndarray, own: int, near: np.ndarray, distance2: np.ndarray, radius: float, spread: np.ndarray
) -> int:
    """Fill ``spread`` with the neighbours' covariance about the node; return the number of neighbours at other
    positions.

    A neighbour's weight is ``radius`` minus its distance from the node. Since only the axes are used, the covariance is
    not divided by the sum of the weights.
    """
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    count = 0
    for m in range(len(near)):
        other = near[m]
        dx = np.float64(points[other, 0] - points[own, 0])
        dy = np.float64(points[other, 1] - points[own, 1])
        dz = np.float64(points[other, 2] - points[own, 2])
        weight = radius - np.sqrt(np.float64(distance2[m]))
        count += distance2[m] > 0.0
        xx, xy, xz = xx + weight * dx * dx, xy + weight * dx * dy, xz + weight * dx * dz
        yy, yz, zz = yy + weight * dy * dy, yz + weight * dy * dz, zz + weight * dz * dz
    spread[0, 0], spread[1, 1], spread[2, 2] = xx, yy, zz
    spread[0, 1] = spread[1, 0] = xy
    spread[0, 2] = spread[2, 0] = xz
    spread[1, 2] = spread[2, 1] = yz
    return count


@njit(cache=True, error_model="numpy")
def _points_away(points: np.ndarray, own: int, near: np.ndarray, distance2: np.ndarray, axis: np.ndarray) -> bool:
    """Return whether more neighbours lie on the negative side of the axis than on the positive side."""
    balance = 0
    for m in range(len(near)):
        ahead = _along(points, own, near[m], axis) >= 0.0
        balance += (1 if ahead else -1) if distance2[m] > 0.0 else 0
    if balance != 0:
        return balance < 0
    by_distance = np.argsort(distance2)
    apart = by_distance[np.count_nonzero(distance2 == 0.0) :]
    middle, ahead_count = len(apart) // 2, 0
    for place in range(max(middle - 2, 0), min(middle + 3, len(apart))):
        ahead_count += _along(points, own, near[apart[place]], axis) > 0.0
    return ahead_count < 3


@njit(cache=True)
def _along(points: np.ndarray, own: int, other: int, axis: np.ndarray) -> float:
    dx, dy = points[other, 0] - points[own, 0], points[other, 1] - points[own, 1]
    return dx * axis[0] + dy * axis[1] + (points[other, 2] - points[own, 2]) * axis[2]


@njit(cache=True, error_model="numpy")
def principal_axes(matrix: np.ndarray, axes: np.ndarray) -> None:
    """Fill axes (3, 3) float64, one per row, in the order of the largest, the middle and the smallest eigenvalue.

    matrix (3, 3) float64, symmetric, is overwritten: its diagonal becomes the eigenvalues in this order. The axes have
    unit length and arbitrary signs. Source: Jacobi's cyclic rotations (Golub, Van Loan, Section 8.5).
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
    """Rotate matrix and axes once in the plane of the axes p and q so that matrix[p, q] becomes zero."""
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
