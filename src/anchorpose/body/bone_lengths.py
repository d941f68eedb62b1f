"""The patient's bone lengths, and how sure each is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.body.shape_belief import ShapeBelief
from anchorpose.body.skin_points import FittedShape
from anchorpose.joints import JOINT_INDEX

BONES: Final = tuple(
    (f"{bone}_{side.lower()}", start + side, end + side)
    for bone, start, end in (
        ("upper_arm", "Shoulder", "Elbow"), ("forearm", "Elbow", "Wrist"),
        ("thigh", "Hip", "Knee"), ("shank", "Knee", "Ankle"),
    )
    for side in ("Left", "Right")
)  # fmt: skip
"""Name, and the joints at both ends, which are heads of bones in a row: the length is the same in every pose."""


@dataclass(frozen=True, slots=True)
class BoneLength:
    """Length of a bone from joint to joint, with one standard deviation."""

    bone: str
    length_m: float
    sigma_m: float


def bone_lengths(asset: BodyAsset, belief: ShapeBelief) -> tuple[BoneLength, ...]:
    """Every bone of ``BONES`` on the most likely body; sigma by the information on the shape."""
    span = _spans(asset, belief.shape)
    length_m = np.linalg.norm(span, axis=1)
    start, end = _ends(asset)
    count = len(belief.shape.coefficients)
    basis = asset.bone_head_basis[:count, end] - asset.bone_head_basis[:count, start]  # (k, n, 3)
    rows = np.einsum("kni,ni->nk", basis, span / length_m[:, None])
    sigma_m = np.sqrt(belief.variance(rows))
    return tuple(
        BoneLength(name, float(length), float(sigma))
        for (name, _, _), length, sigma in zip(BONES, length_m, sigma_m, strict=True)
    )


def _spans(asset: BodyAsset, shape: FittedShape) -> np.ndarray:
    """(n, 3) from the first to the second joint of each bone at rest."""
    start, end = _ends(asset)
    heads = shape.body(asset).bone_heads
    return np.asarray(heads[end] - heads[start])


@cache
def _ends(asset: BodyAsset) -> tuple[np.ndarray, np.ndarray]:
    bones = joint_bones(asset)
    ends = np.array([[bones[JOINT_INDEX[start]], bones[JOINT_INDEX[end]]] for _, start, end in BONES])
    return ends[:, 0], ends[:, 1]
