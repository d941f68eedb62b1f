"""Hessian and gradient of many rows with respect to the pose, without ever writing down their Jacobian.

A skin point moves with few bones, so most columns of its row are zero. ``skin_points.pose_jacobian`` is the plain form.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.body.pose import POSE_SIZE
from anchorpose.body.skin_points import PosedPoints, RestPoints, SkinPoints


def accumulate_pose(
    points: SkinPoints, rest: RestPoints, posed: PosedPoints, index: np.ndarray, direction: np.ndarray,
    residual_m: np.ndarray, weight: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """``J^T W J`` (POSE_SIZE, POSE_SIZE) and ``J^T W r`` (POSE_SIZE,); arguments as in ``pose_jacobian``."""
    transforms, moving = posed.transforms, points.moving
    parent = points.asset.bone_parents[moving]
    frame = np.where((parent >= 0)[:, None, None], transforms[parent, :3, :3], np.eye(3))
    pivot = np.einsum("mij,mj->mi", transforms[moving, :3, :3], rest.body.bone_heads[moving])
    pivot += transforms[moving, :3, 3]
    lever, share = _levers(points.weights, points.below, transforms, rest.points_m, pivot)
    hessian, gradient = np.zeros((POSE_SIZE, POSE_SIZE)), np.zeros(POSE_SIZE)
    _accumulate(lever, share, frame, index, direction, residual_m, weight, hessian, gradient)
    lower = np.tril_indices(POSE_SIZE, -1)
    hessian[lower] = hessian.T[lower]
    return hessian, gradient


@njit(cache=True)
def _levers(
    weights: np.ndarray, below: np.ndarray, transforms: np.ndarray, rest_m: np.ndarray, pivot: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(p, m, 3) weighted arm from each moving bone's head to what it carries of each point, and the weight (p, m)."""
    count, moving, bones = len(weights), len(below), weights.shape[1]
    lever, share = np.zeros((count, moving, 3)), np.zeros((count, moving))
    place = np.empty(3)
    for p in range(count):
        for b in range(bones):
            w = weights[p, b]
            if w == 0.0:
                continue
            for i in range(3):
                place[i] = transforms[b, i, 3]
                for j in range(3):
                    place[i] += transforms[b, i, j] * rest_m[p, j]
            for m in range(moving):
                if below[m, b] > 0.0:
                    share[p, m] += w
                    for i in range(3):
                        lever[p, m, i] += w * (place[i] - pivot[m, i])
    return lever, share


@njit(cache=True)
def _accumulate(
    lever: np.ndarray, share: np.ndarray, frame: np.ndarray, index: np.ndarray, direction: np.ndarray,
    residual: np.ndarray, weight: np.ndarray, hessian: np.ndarray, gradient: np.ndarray,
) -> None:  # fmt: skip
    """Upper triangle of the hessian, and the gradient, in place."""
    moving, size = lever.shape[1], len(gradient)
    column, value, torque = np.empty(size, np.int64), np.empty(size), np.empty(3)
    for r in range(len(index)):
        p = index[r]
        d0, d1, d2 = direction[r, 0], direction[r, 1], direction[r, 2]
        used = 0
        for m in range(moving):
            if share[p, m] == 0.0:
                continue
            l0, l1, l2 = lever[p, m, 0], lever[p, m, 1], lever[p, m, 2]
            torque[0], torque[1], torque[2] = l1 * d2 - l2 * d1, l2 * d0 - l0 * d2, l0 * d1 - l1 * d0
            for k in range(3):
                column[used] = 3 * m + k
                value[used] = torque[0] * frame[m, 0, k] + torque[1] * frame[m, 1, k] + torque[2] * frame[m, 2, k]
                used += 1
        for k in range(3):
            column[used], value[used] = size - 3 + k, direction[r, k]
            used += 1
        for a in range(used):
            scaled = weight[r] * value[a]
            gradient[column[a]] += scaled * residual[r]
            for b in range(a, used):
                hessian[column[a], column[b]] += scaled * value[b]
