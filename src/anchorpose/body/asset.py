"""Define the body asset, the stored model of human bodies: mean adult, shape basis, skeleton and skinning weights. The
asset is built by ``tools/build_body_asset.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np

from anchorpose.joints import JOINT_NAMES

JOINT_BONES = {
    "SpineBase": "Hips",
    "SpineMid": "Spine",
    "SpineShoulder": "Neck",
    "Neck": "Neck1",
    "Head": "Head",
    "ShoulderLeft": "LeftArm",
    "ElbowLeft": "LeftForeArm",
    "WristLeft": "LeftHand",
    "HandLeft": "LeftFingerBase",
    "ShoulderRight": "RightArm",
    "ElbowRight": "RightForeArm",
    "WristRight": "RightHand",
    "HandRight": "RightFingerBase",
    "HipLeft": "LeftUpLeg",
    "KneeLeft": "LeftLeg",
    "AnkleLeft": "LeftFoot",
    "FootLeft": "LeftToeBase",
    "HipRight": "RightUpLeg",
    "KneeRight": "RightLeg",
    "AnkleRight": "RightFoot",
    "FootRight": "RightToeBase",
}
"""The bone that carries each joint. The joint is at the first end of its bone; only the joint ``Head`` is at the middle
of its bone."""

ADULT_COMPONENTS = 16
"""Number of shape coefficients that describe how adults differ; they come before all other coefficients."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyAsset:
    """A skinned triangle mesh in the rest pose; k shape coefficients change the mesh linearly. Coordinates are in
    metres: X points forward, Y up and Z to the right.
    """

    vertices: np.ndarray  # (v, 3) skin of the mean adult
    vertex_basis: np.ndarray  # (k, v, 3) change of the skin by one unit of each shape coefficient
    bone_heads: np.ndarray  # (b, 3) first ends of the mean adult's bones
    bone_head_basis: np.ndarray  # (k, b, 3) change of the bones' first ends by one unit of each shape coefficient
    bone_tails: np.ndarray  # (b, 3) second ends of the mean adult's bones
    bone_tail_basis: np.ndarray  # (k, b, 3) change of the bones' second ends by one unit of each shape coefficient
    bone_names: tuple[str, ...]
    bone_parents: np.ndarray  # (b,) int, index of each bone's parent, -1 for the root; parents come before children
    skin_bones: np.ndarray  # (v, w) bones that move each vertex by linear blend skinning
    skin_weights: np.ndarray  # (v, w) weights of the bones in ``skin_bones``; each row sums to 1
    faces: np.ndarray  # (f, 3) int32, vertices of each triangle, counter-clockwise seen from outside
    # (c,) standard deviation, among adults, of each shape coefficient that changes the whole body; the mean is 0
    adult_sigma: np.ndarray
    child_mean: np.ndarray  # (c,) mean of the whole-body coefficients in children 0.95 to 1.60 m tall
    child_covariance: np.ndarray  # (c, c) covariance of the whole-body coefficients in these children
    # names of the last shape coefficients, each of which changes one body segment (``segments.py``)
    own_names: tuple[str, ...] = ()

    @property
    def shape_count(self) -> int:
        """Return the number of shape coefficients."""
        return len(self.vertex_basis)

    @property
    def common_count(self) -> int:
        """Return the number of shape coefficients that change the whole body, left and right equally; these
        coefficients come before the coefficients of single segments.
        """
        return len(self.vertex_basis) - len(self.own_names)

    def bone(self, name: str) -> int:
        """Return the index of the bone with this name."""
        return self.bone_names.index(name)

    def own_row(self, name: str) -> int:
        """Return the index, among all shape coefficients, of the coefficient with this name in ``own_names``."""
        return self.common_count + self.own_names.index(name)

    def main_bone(self) -> np.ndarray:
        """Return (v,) int: the bone that moves each vertex most. The vertex belongs to this bone's body part."""
        return self.skin_bones[np.arange(len(self.skin_bones)), self.skin_weights.argmax(axis=1)]


@cache
def stored_asset() -> BodyAsset:
    """Return the asset that ships with the package. All shape coefficients of this asset change the whole body; none
    changes a single body segment alone.
    """
    with resources.files("anchorpose.body").joinpath("data/body.npz").open("rb") as stream, np.load(stream) as stored:
        weights = stored["skin_weights"].astype(np.float64)
        return BodyAsset(
            vertices=stored["vertices"].astype(np.float64),
            vertex_basis=stored["vertex_basis"].astype(np.float64),
            bone_heads=stored["bone_heads"],
            bone_head_basis=stored["bone_head_basis"],
            bone_tails=stored["bone_tails"],
            bone_tail_basis=stored["bone_tail_basis"],
            bone_names=tuple(str(name) for name in stored["bone_names"]),
            bone_parents=stored["bone_parents"].astype(np.int64),
            skin_bones=stored["skin_bones"].astype(np.int64),
            skin_weights=weights / weights.sum(axis=1, keepdims=True),
            faces=stored["faces"].astype(np.int32),
            adult_sigma=stored["adult_sigma"],
            child_mean=stored["child_mean"],
            child_covariance=stored["child_covariance"],
        )


@cache
def joint_bones(asset: BodyAsset) -> np.ndarray:
    """Return (21,) int, read only: index of the bone to which each joint is fixed, in the order of ``JOINT_NAMES``."""
    bones = np.array([asset.bone(JOINT_BONES[name]) for name in JOINT_NAMES])
    bones.setflags(write=False)
    return bones
