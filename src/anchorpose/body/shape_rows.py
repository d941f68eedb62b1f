"""Compute derivatives of constraint rows (linear equations on skin points) with respect to pose, shape and clothes
together. The code is compiled, since learning needs these derivatives for every node of many frames.

The reference implementations are ``skin_points.pose_jacobian`` and, in the tests, ``shape_jacobian``.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg.blas import dsyrk

from anchorpose.body.constraints import Constraints
from anchorpose.body.kinematics import joint_frames
from anchorpose.body.pose import POSE_SIZE
from anchorpose.body.skin_points import Body, PosedPoints, SkinPoints, shape_offsets


class FreeShape(NamedTuple):
    """The numbers of shape parameters that are fitted; all other parameters keep their values."""

    coefficients: int  # number of fitted coefficients, counted from the shape's first coefficient
    offsets: int  # number of fitted offsets of clothes and patches, counted from the shape's first offset


def accumulate_shape(
    body: Body, posed: PosedPoints, rows: Constraints, residual_m: np.ndarray, weight: np.ndarray, free: FreeShape
) -> tuple[np.ndarray, np.ndarray]:
    """Return the hessian ``J^T W J`` (s, s) and the gradient ``J^T W r`` (s,) of constraint rows for s parameters: the
    parameters of the pose, then the fitted parameters of the shape. J is ``full_jacobian`` of the rows. residual_m,
    weight (n,): r and the diagonal of W, one value per row.
    """
    jacobian = full_jacobian(body, posed, rows.point, rows.direction, free)
    lower = dsyrk(1.0, (jacobian * np.sqrt(weight)[:, None]).T)
    return lower + np.triu(lower, 1).T, jacobian.T @ (weight * residual_m)


def full_jacobian(
    body: Body, posed: PosedPoints, index: np.ndarray, direction: np.ndarray, free: FreeShape
) -> np.ndarray:
    """Return the Jacobian (n, s): the derivative of each chosen skin point's movement along its direction, by the
    parameters of the pose, then by the fitted parameters of the shape.
    """
    points = body.points
    pivot, frame = joint_frames(posed.transforms, body.mesh.bone_heads, points.asset.bone_parents, points.moving)
    bones = _Bones(
        posed.transforms, pivot, frame, _chains(points), shape_offsets(points.asset, posed, free.coefficients)
    )
    covered = np.ascontiguousarray(points.covered[:, : free.offsets])  # the kernel is compiled for contiguous arrays
    skin = _Skin(points.bones, points.influence, body.rest_m, _point_basis(points), covered)
    jacobian = np.zeros((len(index), POSE_SIZE + sum(free)))
    _fill(skin, bones, index, direction, posed.normals, jacobian)
    return jacobian


class _Skin(NamedTuple):
    """Arrays that describe the skin, with a row per skin point."""

    bones: np.ndarray  # (p, w) bones that move the point, the largest weight first
    influence: np.ndarray  # (p, w) weights of these bones
    rest_m: np.ndarray  # (p, 3) m, place of the point in the rest pose
    basis: np.ndarray  # (p, k, 3) change of the point's rest place by one unit of each coefficient
    covered: np.ndarray  # (p, c) share of each offset by which the point moves


class _Bones(NamedTuple):
    """Arrays that describe the skeleton, with a row per bone or per moving bone."""

    transforms: np.ndarray  # (b, 4, 4) T_world_rest of each bone
    pivot: np.ndarray  # (m, 3) joint at which each moving bone begins, world, from ``joint_frames``
    frame: np.ndarray  # (m, 3, 3) axes about which each moving bone turns, from ``joint_frames``
    chain: np.ndarray  # (b, d) moving bones that carry each bone, padded with -1
    # (b, count, 3) m, by how much one unit of each coefficient changes the translation of each bone's motion from the
    # rest pose to the posed body; the bone's posed points move by this much in addition to the effect of their change
    # at rest; from ``shape_offsets``
    offset: np.ndarray


@cache
def _point_basis(points: SkinPoints) -> np.ndarray:
    return np.ascontiguousarray(points.asset.vertex_basis[:, points.vertex].transpose(1, 0, 2))


@cache
def _chains(points: SkinPoints) -> np.ndarray:
    """Return (b, d), for each bone, the indices in ``MOVING_BONES`` of the bone and its ancestors, as far as they are
    moving bones; padded with -1.
    """
    carried = [np.flatnonzero(column) for column in points.below.T]
    chains = np.full((len(carried), max(map(len, carried))), -1)
    for bone, rows in enumerate(carried):
        chains[bone, : len(rows)] = rows
    return chains


@njit(cache=True)
def _fill(
    skin: _Skin, bones: _Bones, index: np.ndarray, direction: np.ndarray, normals: np.ndarray, jacobian: np.ndarray
) -> None:
    moving, count = len(bones.pivot), bones.offset.shape[1]
    carried, share = np.empty((moving, 3)), np.empty(moving)
    local, place = np.empty(3), np.empty(3)
    for row in range(len(index)):
        p, d, out = index[row], direction[row], jacobian[row]
        carried[:], share[:], local[:] = 0.0, 0.0, 0.0
        for w in range(skin.bones.shape[1]):
            weight = skin.influence[p, w]
            if weight == 0.0:
                break
            bone = skin.bones[p, w]
            T = bones.transforms[bone]
            for i in range(3):
                place[i] = T[i, 3]
                for j in range(3):
                    place[i] += T[i, j] * skin.rest_m[p, j]
                    local[j] += weight * T[i, j] * d[i]
            for step in range(bones.chain.shape[1]):
                m = bones.chain[bone, step]
                if m < 0:
                    break
                share[m] += weight
                for i in range(3):
                    carried[m, i] += weight * place[i]
            for k in range(count):
                offset = bones.offset[bone, k]
                out[POSE_SIZE + k] += weight * (offset[0] * d[0] + offset[1] * d[1] + offset[2] * d[2])
        _turns(bones, carried, share, d, out)
        for k in range(count):
            add = skin.basis[p, k]
            out[POSE_SIZE + k] += local[0] * add[0] + local[1] * add[1] + local[2] * add[2]
        outward = normals[p, 0] * d[0] + normals[p, 1] * d[1] + normals[p, 2] * d[2]
        for c in range(skin.covered.shape[1]):
            out[POSE_SIZE + count + c] = skin.covered[p, c] * outward


@njit(cache=True)
def _turns(bones: _Bones, carried: np.ndarray, share: np.ndarray, d: np.ndarray, out: np.ndarray) -> None:
    """Write, to ``out``, the derivatives of a constraint row by the pose parameters: first by the turns of moving bones
    about the axes of their parents' frames, then by the root's place.
    """
    for m in range(len(share)):
        if share[m] == 0.0:
            continue
        x = carried[m, 0] - share[m] * bones.pivot[m, 0]
        y = carried[m, 1] - share[m] * bones.pivot[m, 1]
        z = carried[m, 2] - share[m] * bones.pivot[m, 2]
        tx, ty, tz = y * d[2] - z * d[1], z * d[0] - x * d[2], x * d[1] - y * d[0]
        for j in range(3):
            out[3 * m + j] = tx * bones.frame[m, 0, j] + ty * bones.frame[m, 1, j] + tz * bones.frame[m, 2, j]
    for j in range(3):
        out[POSE_SIZE - 3 + j] = d[j]
