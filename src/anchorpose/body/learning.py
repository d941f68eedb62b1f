"""The patient's body: shape and clothing learnt from several frames at once, and the bone lengths that follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.evidence import Evidence, evidence_rows
from anchorpose.body.fit import ShapeFrame, learn_shape_step
from anchorpose.body.pose import Pose
from anchorpose.body.shape_belief import ShapeBelief
from anchorpose.body.skin_points import FittedShape, SkinPoints, build_body
from anchorpose.joints import JOINT_INDEX

REACHES_M: Final = (0.12, 0.10, 0.10, 0.08, 0.08, 0.06, 0.06, 0.06)  # of each step


@dataclass(frozen=True, slots=True, eq=False)
class LearnedBody:
    """What is known of the shape, and the pose of each frame it was learnt from."""

    belief: ShapeBelief
    poses: tuple[Pose, ...]


def learn_body(
    points: SkinPoints,
    shape: FittedShape,
    poses: Sequence[Pose],
    evidence: Sequence[Evidence],
    known: ShapeBelief,
    config: RegistrationConfig,
) -> LearnedBody:
    """One shape for all frames, each frame's own pose: alternate correspondences and a joint Gauss-Newton step.

    shape: to start from. known: what is known of it without these frames, from a prior or from earlier frames: where
    that is certain, these frames hardly change it; where it is not, they decide.
    Raises ValueError when no frame is given.
    """
    if not poses:
        raise ValueError("a body needs at least one frame to be learnt from")
    current, learned = list(poses), ShapeBelief(shape, known.information)
    for reach_m in REACHES_M:
        body = build_body(points, learned.shape)
        frames = [
            ShapeFrame(pose, evidence_rows(body, pose, seen, reach_m, config))
            for pose, seen in zip(current, evidence, strict=True)
        ]
        learned, current = learn_shape_step(points, learned.shape, frames, known, config.rows_per_observation)
    return LearnedBody(learned, tuple(current))


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
