"""Pose a body by forward kinematics and linear blend skinning, in compiled code. A body may lack limbs or parts of
limbs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numba import njit

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.joints import ANCHOR_NAMES, JOINT_INDEX


@dataclass(frozen=True, slots=True, eq=False)
class BodyMesh:
    """One person's skin and skeleton in the rest pose. Axes and units are the same as in ``BodyAsset``."""

    asset: BodyAsset
    vertices: np.ndarray  # (v, 3) places of the skin's vertices
    bone_heads: np.ndarray  # (b, 3) first ends of the bones
    bone_tails: np.ndarray  # (b, 3) second ends of the bones

    def bone_transforms(self, rotations: np.ndarray, root_m: np.ndarray) -> np.ndarray:
        """Compute the rigid motion of each bone from the rest pose to the posed body (forward kinematics).

        rotations : (b, 3, 3), each bone's rotation relative to its parent, in the axes of the rest pose. root_m : (3,)
        m, place of the root bone's head (first end) in the world.
        Returns T_world_rest : (b, 4, 4).
        """
        return forward(self.asset.bone_parents, self.bone_heads, rotations, root_m)

    def skin(self, transforms: np.ndarray) -> np.ndarray:
        """Return the posed skin (v, 3), world. transforms: from ``bone_transforms``."""
        weights, bones = self.asset.skin_weights, self.asset.skin_bones
        posed = np.zeros_like(self.vertices)
        for influence in range(weights.shape[1]):
            moved = transforms[bones[:, influence]]
            place = np.einsum("vij,vj->vi", moved[:, :3, :3], self.vertices) + moved[:, :3, 3]
            posed += weights[:, influence, None] * place
        return posed

    def rest_joints(self) -> np.ndarray:
        """Return the joints (21, 3) in the rest pose, in the order of ``JOINT_NAMES``."""
        bones = joint_bones(self.asset)
        joints = self.bone_heads[bones].copy()
        head = JOINT_INDEX["Head"]
        joints[head] = (self.bone_heads[bones[head]] + self.bone_tails[bones[head]]) / 2.0
        return joints

    def joints(self, transforms: np.ndarray) -> np.ndarray:
        """Return the posed joints (21, 3), in the order of ``JOINT_NAMES``. By rule J of the paper (Section III), a
        joint is the mean of its places on the two body parts that it joins; here both places are the same, since the
        parts stay joined.
        """
        moved = transforms[joint_bones(self.asset)]
        return np.einsum("jab,jb->ja", moved[:, :3, :3], self.rest_joints()) + moved[:, :3, 3]


def shape_body(asset: BodyAsset, coefficients: np.ndarray) -> BodyMesh:
    """Return the body with the given shape coefficients (k,), k up to ``asset.shape_count``; 0 is the mean adult."""
    used = len(coefficients)
    if used > asset.shape_count:
        raise ValueError(f"{used} shape coefficients given, the asset has {asset.shape_count}")
    return BodyMesh(
        asset=asset,
        vertices=asset.vertices + np.tensordot(coefficients, asset.vertex_basis[:used], axes=1),
        bone_heads=asset.bone_heads + np.tensordot(coefficients, asset.bone_head_basis[:used], axes=1),
        bone_tails=asset.bone_tails + np.tensordot(coefficients, asset.bone_tail_basis[:used], axes=1),
    )


@njit(cache=True, nogil=True)
def forward(parents: np.ndarray, heads: np.ndarray, rotations: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Return the rigid motion T_world_rest (b, 4, 4) of each bone from the rest pose to the posed body, as described in
    ``BodyMesh.bone_transforms``.
    """
    transforms = np.zeros((len(parents), 4, 4))
    for bone in range(len(parents)):
        parent = parents[bone]
        turn = transforms[bone]
        turn[3, 3] = 1.0
        for i in range(3):
            if parent < 0:
                place = root[i]
                for j in range(3):
                    turn[i, j] = rotations[bone, i, j]
            else:
                place = transforms[parent, i, 3]
                for j in range(3):
                    place += transforms[parent, i, j] * heads[bone, j]
                    total = 0.0
                    for k in range(3):
                        total += transforms[parent, i, k] * rotations[bone, k, j]
                    turn[i, j] = total
            for j in range(3):
                place -= turn[i, j] * heads[bone, j]
            turn[i, 3] = place
    return transforms


@njit(cache=True, nogil=True)
def skin(
    bones: np.ndarray, weights: np.ndarray, transforms: np.ndarray, rest_m: np.ndarray, rest_normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return posed points and unit normals (p, 3) by linear blend skinning. bones, weights (p, w): the bones that move
    each point and their weights, the largest weight first; a weight of 0 ends the list of a point.
    """
    points, normals = np.empty_like(rest_m), np.empty_like(rest_normals)
    blend = np.empty((3, 4))
    for p in range(len(rest_m)):
        blend[:] = 0.0
        for influence in range(bones.shape[1]):
            weight = weights[p, influence]
            if weight == 0.0:
                break
            bone = transforms[bones[p, influence]]
            for i in range(3):
                for j in range(4):
                    blend[i, j] += weight * bone[i, j]
        squared = 0.0
        for i in range(3):
            points[p, i], normals[p, i] = blend[i, 3], 0.0
            for j in range(3):
                points[p, i] += blend[i, j] * rest_m[p, j]
                normals[p, i] += blend[i, j] * rest_normals[p, j]
            squared += normals[p, i] ** 2
        length = np.sqrt(squared)
        for i in range(3):
            normals[p, i] /= length
    return points, normals


@njit(cache=True, nogil=True)
def joint_frames(
    transforms: np.ndarray, heads: np.ndarray, parents: np.ndarray, moving: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pivot (m, 3) and the frame (m, 3, 3) of each moving bone. The pivot is the place of the bone's head
    (first end) in the world. The frame has the axes of the parent bone, about which the bone turns.
    """
    pivot, frame = np.empty((len(moving), 3)), np.empty((len(moving), 3, 3))
    for m in range(len(moving)):
        bone, parent = moving[m], parents[moving[m]]
        for i in range(3):
            pivot[m, i] = transforms[bone, i, 3]
            for j in range(3):
                pivot[m, i] += transforms[bone, i, j] * heads[bone, j]
                if parent >= 0:
                    frame[m, i, j] = transforms[parent, i, j]
                else:
                    frame[m, i, j] = 1.0 if i == j else 0.0
    return pivot, frame


@njit(cache=True, nogil=True)
def joint_derivative(
    pivot: np.ndarray, frame: np.ndarray, below: np.ndarray, bones: np.ndarray, joints_m: np.ndarray
) -> np.ndarray:
    """Return the derivative (n, 3, 3 m + 3) of joints by the pose, for ``skin_points.joint_jacobian``. The derivative
    by a turn about an axis of a bone's frame is the cross product of this axis with the vector from the bone's pivot to
    the joint.
    """
    moving = len(pivot)
    jacobian = np.zeros((len(bones), 3, 3 * moving + 3))
    for n in range(len(bones)):
        for m in range(moving):
            if below[m, bones[n]] == 0.0:
                continue
            x, y, z = joints_m[n, 0] - pivot[m, 0], joints_m[n, 1] - pivot[m, 1], joints_m[n, 2] - pivot[m, 2]
            for k in range(3):
                a, b, c = frame[m, 0, k], frame[m, 1, k], frame[m, 2, k]
                jacobian[n, 0, 3 * m + k] = b * z - c * y
                jacobian[n, 1, 3 * m + k] = c * x - a * z
                jacobian[n, 2, 3 * m + k] = a * y - b * x
        for i in range(3):
            jacobian[n, i, 3 * moving + i] = 1.0
    return jacobian


_STUMPS: Final = {"arm": "Arm", "forearm": "ForeArm", "hand": "Hand", "leg": "UpLeg", "shank": "Leg", "foot": "Foot"}
"""For each body part that a person may lack, the bone at whose head (first end) the part begins."""


def stump_of(asset: BodyAsset, part: str) -> int:
    """Return the bone at whose head (first end) a missing part such as ``shank_left`` begins; a body without this part
    lacks the bone and all its descendants.
    """
    name, side = part.rsplit("_", 1)
    return asset.bone(f"{side.capitalize()}{_STUMPS[name]}")


def below(asset: BodyAsset, bone: int) -> np.ndarray:
    """Return (b,) bool: True for a bone and all its descendants in the skeleton."""
    found = np.zeros(len(asset.bone_names), bool)
    found[bone] = True
    for other, parent in enumerate(asset.bone_parents.tolist()):  # parents come before children
        found[other] |= parent >= 0 and bool(found[parent])
    return found


def without_parts(mesh: BodyMesh, parts: Sequence[str]) -> BodyMesh:
    """Return the body without some parts, such as ``shank_left``. The skin and bones of each missing part shrink to the
    joint where the part would begin, so that rotations of these bones move nothing.
    """
    vertices, heads, tails = mesh.vertices.copy(), mesh.bone_heads.copy(), mesh.bone_tails.copy()
    for part in parts:
        stump = stump_of(mesh.asset, part)
        bones = below(mesh.asset, stump)
        vertices[bones[mesh.asset.main_bone()]] = heads[stump]
        heads[bones], tails[bones] = heads[stump], heads[stump]
    return replace(mesh, vertices=vertices, bone_heads=heads, bone_tails=tails)


def missing_points(asset: BodyAsset, part_of_points: np.ndarray, parts: Sequence[str]) -> np.ndarray:
    """Return (p,) bool: whether each skin point is on a missing part. part_of_points (p,): the bone that moves each
    point most.
    """
    return np.isin(part_of_points, np.flatnonzero(_missing_bones(asset, parts)))


def missing_joints(asset: BodyAsset, parts: Sequence[str]) -> np.ndarray:
    """Return (21,) bool: whether each joint is on a missing part. The joint where a missing part would begin is not
    missing.
    """
    bones = joint_bones(asset)
    stumps = [stump_of(asset, part) for part in parts]
    outermost = [stump for stump in stumps if not any(below(asset, other)[stump] for other in stumps if other != stump)]
    return np.asarray(_missing_bones(asset, parts)[bones] & ~np.isin(bones, outermost))


def missing_anchors(parts: Sequence[str]) -> np.ndarray:
    """Return (5,) bool, in the order of ``ANCHOR_NAMES``: hands and feet that a body without these parts lacks."""
    ends = {"arm": "Hand", "forearm": "Hand", "hand": "Hand", "leg": "Foot", "shank": "Foot", "foot": "Foot"}
    gone = {f"{ends[name]}{side.capitalize()}" for name, side in (part.rsplit("_", 1) for part in parts)}
    return np.isin(ANCHOR_NAMES, list(gone))


def _missing_bones(asset: BodyAsset, parts: Sequence[str]) -> np.ndarray:
    found = np.zeros(len(asset.bone_names), bool)
    for part in parts:
        found |= below(asset, stump_of(asset, part))
    return found
