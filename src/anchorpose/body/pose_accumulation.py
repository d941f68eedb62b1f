"""Compute Hessian and gradient of many constraint rows (linear equations on skin points) with respect to the pose,
without storing the rows' Jacobian.

The derivative of a row with respect to a bone's turn is ``cross(x - pivot, direction)``, where x is the row's skin
point. This derivative is linear in the six numbers ``(cross(x, direction), direction)``. So rows are first summed into
a matrix per skin point (3 x 3), then into a matrix per pair of moving bones that carry a point together (6 x 6), and
then along the skeleton. The last step converts the sums to the pose's parameters. ``skin_points.pose_jacobian``, which
returns the derivatives of every row, is the reference implementation.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit

from anchorpose.body.kinematics import joint_frames
from anchorpose.body.skin_points import Body, PosedPoints, SkinPoints


def accumulate_pose(
    body: Body, posed: PosedPoints, index: np.ndarray, direction: np.ndarray, residual_m: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return ``J^T W J`` (POSE_SIZE, POSE_SIZE) and ``J^T W r`` (POSE_SIZE,), where J is ``pose_jacobian`` of the rows,
    W the diagonal matrix of their weights, and r their residuals.
    """
    points, parents = body.points, body.points.asset.bone_parents
    pivot, frame = joint_frames(posed.transforms, body.mesh.bone_heads, parents, points.moving)
    spread, pull = _by_point(len(body.rest_m), index, direction, residual_m, weight)
    carrier, above = _carriers(points)
    pairs, forces = _by_bones(
        points.bones, points.influence, carrier, len(above), posed.transforms, body.rest_m, spread, pull
    )
    _down_the_skeleton(above, pairs, forces)
    return _by_parameter(pivot, frame, pairs, forces)


@cache
def _carriers(points: SkinPoints) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each bone (b,), the moving bone that carries it: the bone itself or its nearest moving ancestor. Also
    return, for each moving bone (m,), the next moving bone above it in the skeleton, -1 for the root. Moving bones are
    numbered as in ``SkinPoints.moving``, parents before children.
    """
    # a bone is carried by the last moving bone that is the bone itself or one of its ancestors
    carrier = len(points.moving) - 1 - points.below[::-1].argmax(axis=0)
    parents = points.asset.bone_parents[points.moving]
    return carrier, np.where(parents >= 0, carrier[parents], -1)


@njit(cache=True, nogil=True)
def _by_point(
    count: int, index: np.ndarray, direction: np.ndarray, residual: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return two sums per skin point, over all rows of this point: the sum of weight * direction * direction^T (p, 3,
    3), and the sum of weight * direction * residual (p, 3).
    """
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
    carrier: np.ndarray,
    count: int,
    transforms: np.ndarray,
    rest_m: np.ndarray,
    spread: np.ndarray,
    pull: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return two sums over all constraint rows. The first sum holds the second moments (m, m, 6, 6) for each pair of
    carriers (moving bones that carry a point): the weighted products of the six numbers ``(cross(x, direction),
    direction)`` of the pair's first carrier with the six numbers of its second carrier. The second sum holds the torque
    about the world's origin and the force (m, 6) on each carrier. The force of a row is its weighted residual along its
    direction.

    For each pair of carriers of a skin point, the loop adds the moments in one order of the pair only; ``_mirror`` then
    adds up the moments of both orders.
    """
    pairs, forces = np.zeros((count, count, 6, 6)), np.zeros((count, 6))
    most = bones.shape[1]
    carriers, place, share, half = np.empty(most, np.int64), np.empty((most, 3)), np.empty(most), np.empty((6, 3))
    for p in range(len(rest_m)):
        if spread[p, 0, 0] + spread[p, 1, 1] + spread[p, 2, 2] == 0.0:
            continue
        used, k = 0, 0
        while k < most and influence[p, k] > 0.0:
            bone, slot = bones[p, k], 0
            while slot < used and carriers[slot] != carrier[bone]:
                slot += 1
            if slot == used:
                carriers[slot], share[slot], used = carrier[bone], 0.0, used + 1
                place[slot, 0], place[slot, 1], place[slot, 2] = 0.0, 0.0, 0.0
            _add_place(transforms[bone], rest_m[p], influence[p, k], place[slot])
            share[slot] += influence[p, k]
            k += 1
        for one in range(used):
            x, y, z = place[one, 0], place[one, 1], place[one, 2]
            force = forces[carriers[one]]
            force[0] += y * pull[p, 2] - z * pull[p, 1]
            force[1] += z * pull[p, 0] - x * pull[p, 2]
            force[2] += x * pull[p, 1] - y * pull[p, 0]
            for j in range(3):
                force[3 + j] += share[one] * pull[p, j]
                half[0, j] = y * spread[p, 2, j] - z * spread[p, 1, j]
                half[1, j] = z * spread[p, 0, j] - x * spread[p, 2, j]
                half[2, j] = x * spread[p, 1, j] - y * spread[p, 0, j]
                for i in range(3):
                    half[3 + i, j] = share[one] * spread[p, i, j]
            for other in range(one, used):
                moment, part = pairs[carriers[one], carriers[other]], share[other]
                x, y, z = place[other, 0], place[other, 1], place[other, 2]
                for i in range(6):
                    moment[i, 0] += y * half[i, 2] - z * half[i, 1]
                    moment[i, 1] += z * half[i, 0] - x * half[i, 2]
                    moment[i, 2] += x * half[i, 1] - y * half[i, 0]
                    moment[i, 3] += part * half[i, 0]
                    moment[i, 4] += part * half[i, 1]
                    moment[i, 5] += part * half[i, 2]
    _mirror(pairs)
    return pairs, forces


@njit(cache=True, nogil=True)
def _add_place(T_world_rest: np.ndarray, rest_m: np.ndarray, share: float, place: np.ndarray) -> None:
    """Add, to ``place`` (3,), the point to which one bone alone would move a skin point, multiplied by the bone's
    ``share``.
    """
    T, r = T_world_rest, rest_m
    for i in range(3):
        place[i] += share * (T[i, 3] + T[i, 0] * r[0] + T[i, 1] * r[1] + T[i, 2] * r[2])


@njit(cache=True, nogil=True)
def _mirror(pairs: np.ndarray) -> None:
    """Add, in place, the transposed moments of each pair of different carriers to the moments of the pair in the
    opposite order. A carrier's moments with itself are complete and stay unchanged.
    """
    for one in range(len(pairs)):
        for other in range(one):
            for i in range(6):
                for j in range(6):
                    both = pairs[one, other, i, j] + pairs[other, one, j, i]
                    pairs[one, other, i, j], pairs[other, one, j, i] = both, both


@njit(cache=True, nogil=True)
def _down_the_skeleton(parents: np.ndarray, pairs: np.ndarray, forces: np.ndarray) -> None:
    """Add to each bone's sums the sums of all its descendants, in place. Parents come before children."""
    for bone in range(len(parents) - 1, 0, -1):  # loops instead of slices, which would take seconds to compile
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
    pivot: np.ndarray, frame: np.ndarray, pairs: np.ndarray, forces: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Convert moments and forces about the origin to hessian and gradient in the pose parameters: rotations about the
    pivots in the parents' axes, then the root's translation.
    """
    count = len(pivot)
    screws = _screws(pivot, frame)
    bone = np.arange(count + 1)
    bone[count] = 0  # the root's translation moves the same points as a turn of bone 0
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
    """Return (m + 1, 3, 6): each pose parameter's motion, as a rotation about the origin (3) and a translation (3)."""
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
