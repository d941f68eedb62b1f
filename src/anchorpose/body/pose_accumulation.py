"""Hessian and gradient of many rows with respect to the pose, without ever storing their Jacobian.

A row of a point x on a rigid bone moves with the bone's turn by ``(x - pivot) x direction``, which is linear in the six
numbers ``(x x direction, direction)``. So rows are first summed by skin point (3 x 3), then by pairs of bones that move
a point together (6 x 6), then down the skeleton, and only then turned into parameters.
``skin_points.pose_jacobian`` is the reference implementation.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.body.kinematics import joint_frames
from anchorpose.body.skin_points import Body, PosedPoints


def accumulate_pose(
    body: Body,
    posed: PosedPoints,
    index: np.ndarray,
    direction: np.ndarray,
    residual_m: np.ndarray,
    weight: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """``J^T W J`` (POSE_SIZE, POSE_SIZE) and ``J^T W r`` (POSE_SIZE,); arguments as in ``pose_jacobian``."""
    parents = body.points.asset.bone_parents
    pivot, frame = joint_frames(posed.transforms, body.mesh.bone_heads, parents, body.points.moving)
    spread, pull = _by_point(len(body.rest_m), index, direction, residual_m, weight)
    pairs, forces = _by_bones(body.points.bones, body.points.influence, posed.transforms, body.rest_m, spread, pull)
    _down_the_skeleton(parents, pairs, forces)
    return _by_parameter(body.points.moving, pivot, frame, pairs, forces)


@njit(cache=True, nogil=True)
def _by_point(
    count: int, index: np.ndarray, direction: np.ndarray, residual: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sums over the rows of each skin point: weight x direction x direction^T (p, 3, 3), and x residual (p, 3)."""
    spread, pull = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for r in range(len(index)):
        p = index[r]
        for i in range(3):
            scaled = weight[r] * direction[r, i]
            pull[p, i] += scaled * residual[r]
            for j in range(3):
                spread[p, i, j] += scaled * direction[r, j]
    return spread, pull


@njit(cache=True, nogil=True)
def _by_bones(
    bones: np.ndarray,
    influence: np.ndarray,
    transforms: np.ndarray,
    rest_m: np.ndarray,
    spread: np.ndarray,
    pull: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Moments (b, b, 6, 6) of each pair of bones, and forces (b, 6) on each: torque about the origin, then force.

    Of two bones the heavier comes first, so that the other half of the moments is what ``_mirror`` adds.
    """
    count = len(transforms)
    pairs, forces = np.zeros((count, count, 6, 6)), np.zeros((count, 6))
    arms, half = np.zeros((bones.shape[1], 6, 3)), np.empty((6, 3))
    for p in range(len(rest_m)):
        if spread[p, 0, 0] + spread[p, 1, 1] + spread[p, 2, 2] == 0.0:
            continue
        used = 0
        while used < bones.shape[1] and influence[p, used] > 0.0:
            bone, arm = bones[p, used], arms[used]
            _lever(transforms[bone], rest_m[p], influence[p, used], arm)
            for i in range(6):
                for j in range(3):
                    forces[bone, i] += arm[i, j] * pull[p, j]
            used += 1
        for one in range(used):
            for i in range(6):
                for j in range(3):
                    half[i, j] = 0.0
                    for k in range(3):
                        half[i, j] += arms[one, i, k] * spread[p, k, j]
            for other in range(one, used):
                moment, arm = pairs[bones[p, one], bones[p, other]], arms[other]
                for i in range(6):
                    for j in range(6):
                        moment[i, j] += half[i, 0] * arm[j, 0] + half[i, 1] * arm[j, 1] + half[i, 2] * arm[j, 2]
    _mirror(pairs)
    return pairs, forces


@njit(cache=True, nogil=True)
def _lever(T_world_rest: np.ndarray, rest_m: np.ndarray, share: float, arm: np.ndarray) -> None:
    """Fills arm (6, 3): torque about the origin and force of a force on the point, as far as it is the bone's."""
    T, r = T_world_rest, rest_m
    x = share * (T[0, 3] + T[0, 0] * r[0] + T[0, 1] * r[1] + T[0, 2] * r[2])
    y = share * (T[1, 3] + T[1, 0] * r[0] + T[1, 1] * r[1] + T[1, 2] * r[2])
    z = share * (T[2, 3] + T[2, 0] * r[0] + T[2, 1] * r[1] + T[2, 2] * r[2])
    arm[0, 1], arm[0, 2], arm[1, 0] = -z, y, z
    arm[1, 2], arm[2, 0], arm[2, 1] = -x, -y, x
    arm[3, 0], arm[4, 1], arm[5, 2] = share, share, share


@njit(cache=True, nogil=True)
def _mirror(pairs: np.ndarray) -> None:
    """In place: adds the transpose, except to a bone's moments with itself, which are complete."""
    for one in range(len(pairs)):
        for other in range(one):
            for i in range(6):
                for j in range(6):
                    both = pairs[one, other, i, j] + pairs[other, one, j, i]
                    pairs[one, other, i, j], pairs[other, one, j, i] = both, both


@njit(cache=True, nogil=True)
def _down_the_skeleton(parents: np.ndarray, pairs: np.ndarray, forces: np.ndarray) -> None:
    """In place: adds to each bone what moves its descendants. Parents come before children."""
    for bone in range(len(parents) - 1, 0, -1):  # no slices, which take seconds to compile
        for i in range(6):
            forces[parents[bone], i] += forces[bone, i]
        for other in range(len(parents)):
            for i in range(6):
                for j in range(6):
                    pairs[parents[bone], other, i, j] += pairs[bone, other, i, j]
    for bone in range(len(parents) - 1, 0, -1):
        for other in range(len(parents)):
            for i in range(6):
                for j in range(6):
                    pairs[other, parents[bone], i, j] += pairs[other, bone, i, j]


@njit(cache=True, nogil=True)
def _by_parameter(
    moving: np.ndarray, pivot: np.ndarray, frame: np.ndarray, pairs: np.ndarray, forces: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Moments about the origin to turns about the pivots in the parents' axes; the last three are the root's shift."""
    count = len(moving)
    screws = _screws(pivot, frame)
    bone = np.zeros(count + 1, np.int64)  # the root carries everything
    bone[:count] = moving
    size = 3 * count + 3
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    half = np.empty(6)
    for m in range(count + 1):
        for k in range(3):
            row = 3 * m + k
            for i in range(6):
                gradient[row] += screws[m, k, i] * forces[bone[m], i]
            for n in range(m, count + 1):
                moment = pairs[bone[m], bone[n]]
                for j in range(6):
                    half[j] = 0.0
                    for i in range(6):
                        half[j] += screws[m, k, i] * moment[i, j]
                for c in range(3):
                    total = 0.0
                    for j in range(6):
                        total += half[j] * screws[n, c, j]
                    hessian[row, 3 * n + c] = total
                    hessian[3 * n + c, row] = total
    return hessian, gradient


@njit(cache=True, nogil=True)
def _screws(pivot: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """(m + 1, 3, 6) each parameter as turn and shift about the origin."""
    count = len(pivot)
    screws = np.zeros((count + 1, 3, 6))
    for m in range(count):
        for k in range(3):
            x, y, z = frame[m, 0, k], frame[m, 1, k], frame[m, 2, k]
            screws[m, k, 0], screws[m, k, 1], screws[m, k, 2] = x, y, z
            screws[m, k, 3] = z * pivot[m, 1] - y * pivot[m, 2]
            screws[m, k, 4] = x * pivot[m, 2] - z * pivot[m, 0]
            screws[m, k, 5] = y * pivot[m, 0] - x * pivot[m, 1]
    for k in range(3):
        screws[count, k, 3 + k] = 1.0
    return screws
