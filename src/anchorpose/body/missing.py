"""Limbs that a body lacks: their skin and bones shrink to the joint where the limb would begin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.body.kinematics import BodyMesh
from anchorpose.joints import ANCHOR_NAMES

_STUMPS: Final = {
    "arm": "Arm", "forearm": "ForeArm", "hand": "Hand", "leg": "UpLeg", "shank": "Leg", "foot": "Foot",
}  # fmt: skip
"""The bone at whose head each part would begin."""


def stump_of(asset: BodyAsset, part: str) -> int:
    """The first missing bone of a part such as ``shank_left``."""
    name, side = part.rsplit("_", 1)
    return asset.bone(f"{side.capitalize()}{_STUMPS[name]}")


def below(asset: BodyAsset, bone: int) -> np.ndarray:
    """(b,) bool: the bone and all that hang on it."""
    found = np.zeros(len(asset.bone_names), bool)
    found[bone] = True
    for other, parent in enumerate(asset.bone_parents.tolist()):  # parents stand before children
        found[other] |= parent >= 0 and bool(found[parent])
    return found


def without_parts(mesh: BodyMesh, parts: Sequence[str]) -> BodyMesh:
    """The body without some parts: all of a part lies in the joint where it would begin, and no turn moves it away."""
    vertices, heads, tails = mesh.vertices.copy(), mesh.bone_heads.copy(), mesh.bone_tails.copy()
    for part in parts:
        stump = stump_of(mesh.asset, part)
        bones = below(mesh.asset, stump)
        vertices[bones[mesh.asset.main_bone()]] = heads[stump]
        heads[bones], tails[bones] = heads[stump], heads[stump]
    return replace(mesh, vertices=vertices, bone_heads=heads, bone_tails=tails)


def missing_points(asset: BodyAsset, part_of_points: np.ndarray, parts: Sequence[str]) -> np.ndarray:
    """(p,) bool: points that move most with a missing bone; part_of_points (p,)."""
    return np.isin(part_of_points, np.flatnonzero(_missing_bones(asset, parts)))


def missing_joints(asset: BodyAsset, parts: Sequence[str]) -> np.ndarray:
    """(21,) bool: joints beyond the stumps; the joint where a part would begin is there."""
    bones = joint_bones(asset)
    stumps = [stump_of(asset, part) for part in parts]
    outermost = [stump for stump in stumps if not any(below(asset, other)[stump] for other in stumps if other != stump)]
    return np.asarray(_missing_bones(asset, parts)[bones] & ~np.isin(bones, outermost))


def missing_anchors(parts: Sequence[str]) -> np.ndarray:
    """(5,) bool of ``ANCHOR_NAMES``: hands and feet that are not there."""
    ends = {"arm": "Hand", "forearm": "Hand", "hand": "Hand", "leg": "Foot", "shank": "Foot", "foot": "Foot"}
    gone = {f"{ends[name]}{side.capitalize()}" for name, side in (part.rsplit("_", 1) for part in parts)}
    return np.isin(ANCHOR_NAMES, list(gone))


def _missing_bones(asset: BodyAsset, parts: Sequence[str]) -> np.ndarray:
    found = np.zeros(len(asset.bone_names), bool)
    for part in parts:
        found |= below(asset, stump_of(asset, part))
    return found
