"""Define the body asset: mean adult, shape basis, skeleton and skinning weights, built by
``tools/build_body_asset.py``.
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
"""The bone whose head is the joint; the joint ``Head`` is the middle of its bone."""

ADULT_COMPONENTS = 16
"""Number of the statistical components that describe adults; they come first."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyAsset:
    """A linear shape space over a skinned mesh at rest. Axes X forward, Y up, Z to the body's right; metres."""

    vertices: np.ndarray  # (v, 3) skin of the mean adult
    vertex_basis: np.ndarray  # (k, v, 3) change of the skin by one unit of each shape coefficient
    bone_heads: np.ndarray  # (b, 3) skeleton of the mean adult
    bone_head_basis: np.ndarray  # (k, b, 3) change of the heads by one unit of each coefficient
    bone_tails: np.ndarray  # (b, 3)
    bone_tail_basis: np.ndarray  # (k, b, 3)
    bone_names: tuple[str, ...]
    bone_parents: np.ndarray  # (b,) int, -1 for the root; parents come before children
    skin_bones: np.ndarray  # (v, w) bones that move each vertex by linear blend skinning
    skin_weights: np.ndarray  # (v, w) weights of these bones, each row sums to 1
    faces: np.ndarray  # (f, 3) int32, counter-clockwise seen from outside
    adult_sigma: np.ndarray  # (c,) standard deviations of adults' statistical coefficients; their mean is 0
    child_mean: np.ndarray  # (c,) mean of these coefficients in children of 0.95 to 1.60 m
    child_covariance: np.ndarray  # (c, c) their covariance in these children
    own_names: tuple[str, ...] = ()  # names of the last coefficients, each for a single segment (``segments``)

    @property
    def shape_count(self) -> int:
        """Return the number of shape coefficients."""
        return len(self.vertex_basis)

    @property
    def common_count(self) -> int:
        """Return the number of statistical components: they come first, and change the whole body symmetrically."""
        return len(self.vertex_basis) - len(self.own_names)

    def bone(self, name: str) -> int:
        """Return the index of a bone."""
        return self.bone_names.index(name)

    def own_row(self, name: str) -> int:
        """Return the index, among all shape coefficients, of a name in ``own_names``."""
        return self.common_count + self.own_names.index(name)

    def main_bone(self) -> np.ndarray:
        """Return (v,) int: the bone that moves each vertex most; it is the vertex's body part."""
        return self.skin_bones[np.arange(len(self.skin_bones)), self.skin_weights.argmax(axis=1)]


@cache
def stored_asset() -> BodyAsset:
    """Return the asset that ships with the package; it has only the statistical components."""
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
    """Return (21,) int, read only: the bone that carries each joint, in the order of ``JOINT_NAMES``."""
    bones = np.array([asset.bone(JOINT_BONES[name]) for name in JOINT_NAMES])
    bones.setflags(write=False)
    return bones
