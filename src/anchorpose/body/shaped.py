"""A body of one shape, and its skin and joints in any pose (linear blend skinning)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.body.kinematics import forward
from anchorpose.joints import JOINT_INDEX


@dataclass(frozen=True, slots=True, eq=False)
class ShapedBody:
    """One person's rest skin and skeleton. Axes and units as in ``BodyAsset``."""

    asset: BodyAsset
    vertices: np.ndarray  # (v, 3) rest skin
    bone_heads: np.ndarray  # (b, 3)
    bone_tails: np.ndarray  # (b, 3)

    def bone_transforms(self, rotations: np.ndarray, root_m: np.ndarray) -> np.ndarray:
        """Forward kinematics: rest body to posed body, one rigid motion a bone.

        rotations : (b, 3, 3), each bone's turn relative to its parent, in the axes of the rest pose.
        root_m : (3,), where the head of the root bone goes.
        Returns T_world_rest : (b, 4, 4).
        """
        return forward(self.asset.bone_parents, self.bone_heads, rotations, root_m)

    def skin(self, transforms: np.ndarray) -> np.ndarray:
        """(v, 3) posed skin for ``transforms`` of ``bone_transforms``."""
        weights, bones = self.asset.skin_weights, self.asset.skin_bones
        posed = np.zeros_like(self.vertices)
        for influence in range(weights.shape[1]):
            moved = transforms[bones[:, influence]]
            place = np.einsum("vij,vj->vi", moved[:, :3, :3], self.vertices) + moved[:, :3, 3]
            posed += weights[:, influence, None] * place
        return posed

    def rest_joints(self) -> np.ndarray:
        """(21, 3) joints in the rest pose, order of ``JOINT_NAMES``."""
        bones = joint_bones(self.asset)
        joints = self.bone_heads[bones].copy()
        head = JOINT_INDEX["Head"]
        joints[head] = (self.bone_heads[bones[head]] + self.bone_tails[bones[head]]) / 2.0
        return joints

    def joints(self, transforms: np.ndarray) -> np.ndarray:
        """(21, 3) joints in a pose, order of ``JOINT_NAMES``: the rule J of the paper's Section III."""
        moved = transforms[joint_bones(self.asset)]
        return np.einsum("jab,jb->ja", moved[:, :3, :3], self.rest_joints()) + moved[:, :3, 3]


def shape_body(asset: BodyAsset, coefficients: np.ndarray) -> ShapedBody:
    """The body with the given shape coefficients (k,), k up to ``asset.shape_count``; 0 is the mean adult."""
    used = len(coefficients)
    if used > asset.shape_count:
        raise ValueError(f"{used} shape coefficients given, the asset has {asset.shape_count}")
    return ShapedBody(
        asset=asset,
        vertices=asset.vertices + np.tensordot(coefficients, asset.vertex_basis[:used], axes=1),
        bone_heads=asset.bone_heads + np.tensordot(coefficients, asset.bone_head_basis[:used], axes=1),
        bone_tails=asset.bone_tails + np.tensordot(coefficients, asset.bone_tail_basis[:used], axes=1),
    )
