"""Learn the patient's shape, which includes the bone lengths, from several frames together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import Constraints
from anchorpose.body.evidence import Evidence, evidence_rows, rows_alike
from anchorpose.body.fit import hidden_bones, limited, pose_equations, prior_equations
from anchorpose.body.kinematics import missing_joints
from anchorpose.body.pose import MOVING_BONES, POSE_SIZE, Pose
from anchorpose.body.shape_prior import ShapeBelief
from anchorpose.body.skin_points import FittedShape, SkinPoints, build_body, pose_points, skin_points
from anchorpose.body.standing_off import BONE_SHARE, standing_off
from anchorpose.joints import JOINT_INDEX

# m, maximum distance at which a node (point of the seen surface) pulls the skin, one value per solver step; three more
# steps did not change bone lengths
REACHES_M: Final = (0.12, 0.10, 0.08, 0.06, 0.06)
# m, like ``REACHES_M``, but for a shape that is already known from earlier frames
REFINING_M: Final = (0.07, 0.06)
LARGEST_STEP: Final = 1.0  # maximum change of a shape coefficient in one step of the solver, in standard deviations


@dataclass(frozen=True, slots=True, eq=False)
class LearnedBody:
    """The belief in the learnt shape, and the pose in each frame from which the shape was learnt."""

    belief: ShapeBelief
    poses: tuple[Pose, ...]


def learn_body(
    points: SkinPoints,
    shape: FittedShape,
    poses: Sequence[Pose],
    evidence: Sequence[Evidence],
    known: ShapeBelief,
    config: RegistrationConfig,
    reaches_m: Sequence[float] = REACHES_M,
) -> LearnedBody:
    """Fit a single shape to all frames, and a pose to each frame. Two operations alternate: nodes are matched to skin
    points, and a Gauss-Newton step changes the shape and all poses.

    shape: the initial shape. known: the belief in the shape without these frames, from a prior or from earlier frames.
    The more certain the belief ``known`` is, the less the frames change the shape. Raises ValueError if no frame is
    given.
    """
    if not poses:
        raise ValueError("a body needs at least one frame to be learnt from")
    current, learned = list(poses), replace(known, shape=shape)
    for reach_m in reaches_m:
        body = build_body(points, learned.shape)
        frames = [
            ShapeFrame(pose, evidence_rows(body, pose, seen, reach_m, config), rows_alike(seen, config))
            for pose, seen in zip(current, evidence, strict=True)
        ]
        learned, current = learn_shape_step(points, learned.shape, frames, known)
    return LearnedBody(learned, tuple(current))


def most_different(points: SkinPoints, poses: Sequence[Pose], count: int) -> list[int]:
    """Return increasing indices of up to ``count`` poses whose limbs are bent and turned most differently.

    Poses are chosen one after another, each as different as possible from the poses chosen before. Poses with bent
    limbs show where the joints of these limbs are, and a pose similar to a chosen pose adds no knowledge.
    """
    limbs = [row for row, bone in enumerate(MOVING_BONES) if bone.endswith(("Arm", "UpLeg", "Leg"))]
    turns = np.array([pose.rotation_vectors(points.moving)[limbs].ravel() for pose in poses])
    chosen = [int(np.linalg.norm(turns - turns.mean(axis=0), axis=1).argmax())]
    away = np.linalg.norm(turns - turns[chosen[0]], axis=1)
    while len(chosen) < min(count, len(poses)):
        away[chosen] = -1.0
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(turns - turns[chosen[-1]], axis=1))
    return sorted(chosen)


@dataclass(frozen=True, slots=True, eq=False)
class ShapeFrame:
    """A frame from which the shape is learnt. alike: number of constraint rows that count as one observation."""

    pose: Pose
    constraints: Constraints
    alike: float


def learn_shape_step(
    points: SkinPoints, shape: FittedShape, frames: Sequence[ShapeFrame], known: ShapeBelief
) -> tuple[ShapeBelief, list[Pose]]:
    """Take one Gauss-Newton step on the shape that all frames share and on every frame's pose; the poses are eliminated
    from the equations by the Schur complement.

    known: the belief in the shape without these frames. Return the belief that includes the frames, linearised at
    ``shape``, and the new pose of each frame.
    """
    body, count = build_body(points, shape), known.free.coefficients
    seen, slope = np.zeros_like(known.seen), np.zeros_like(known.pull)
    eliminated = []
    for frame in frames:
        posed = pose_points(body, frame.pose)
        rows, alike = frame.constraints, frame.alike
        hidden = hidden_bones(points, rows, alike)
        prior = prior_equations(points, frame.pose, None, hidden)
        equations = pose_equations(body, frame.pose, posed, rows, prior, alike, known.free)
        h, g = equations.hessian, equations.gradient
        factor = cho_factor(h[:POSE_SIZE, :POSE_SIZE] + 1e-3 * np.diag(np.diag(h)[:POSE_SIZE]))
        cross = cho_solve(factor, h[:POSE_SIZE, POSE_SIZE:])
        alone = cho_solve(factor, g[:POSE_SIZE])
        seen += h[POSE_SIZE:, POSE_SIZE:] - h[POSE_SIZE:, :POSE_SIZE] @ cross
        slope += g[POSE_SIZE:] - h[POSE_SIZE:, :POSE_SIZE] @ alone
        eliminated.append((cross, alone))
    hessian, gradient = known.equations(shape)
    change = -np.linalg.solve(hessian + seen, gradient + slope)
    change *= min(1.0, LARGEST_STEP / float(np.abs(change[:count]).max()))
    poses = [
        frame.pose.moved(limited(-alone - cross @ change), points.moving)
        for frame, (cross, alone) in zip(frames, eliminated, strict=True)
    ]
    return known.having_seen(known.moved(shape, change), seen, seen @ known.vector(shape) - slope), poses


BONES: Final = tuple(
    (f"{bone}_{side.lower()}", start + side, end + side)
    for bone, start, end in (
        ("upper_arm", "Shoulder", "Elbow"),
        ("forearm", "Elbow", "Wrist"),
        ("thigh", "Hip", "Knee"),
        ("shank", "Knee", "Ankle"),
    )
    for side in ("Left", "Right")
)
"""Each reported bone's name and the joints at both ends. These joints are the first ends of successive bones of the
skeleton, so their distance is the same in all poses."""


LEAST_BONE_M: Final = 1e-6  # m; a bone shorter than this counts as missing
SYSTEMATIC_M: Final = {"upper_arm": 0.004, "forearm": 0.008, "thigh": 0.009, "shank": 0.008}
"""Systematic error (m) of a learnt bone length, due to clothes, folds and bodies that differ from the model. More
frames do not reduce this error. The values were determined with the suite ``bodies`` of ``benchmarks/run.py``."""


@dataclass(frozen=True, slots=True)
class BoneLength:
    """Length of a bone from joint to joint, with its standard deviation."""

    bone: str
    length_m: float
    sigma_m: float


def bone_lengths(asset: BodyAsset, belief: ShapeBelief) -> tuple[BoneLength, ...]:
    """Return the lengths of all bones of ``BONES`` that the body has; sigma includes the shape's uncertainty and
    systematic errors.
    """
    span = _spans(asset, belief.shape)
    length_m = np.linalg.norm(span, axis=1)
    start, end = _ends(asset)
    count = belief.free.coefficients
    basis = asset.bone_head_basis[:count, end] - asset.bone_head_basis[:count, start]  # (k, n, 3)
    rows = np.einsum("kni,ni->nk", basis, span / np.maximum(length_m, LEAST_BONE_M)[:, None])
    systematic_m = np.array([SYSTEMATIC_M[name.rsplit("_", 1)[0]] for name, _, _ in BONES])
    off_m = standing_off(skin_points(asset), belief.shape)
    unlike_m = np.array([BONE_SHARE * off_m.get(name, 0.0) for name, _, _ in BONES])  # type: ignore[call-overload]
    sigma_m = np.sqrt(belief.variance(rows) + systematic_m**2 + unlike_m**2)
    missing = missing_joints(asset, belief.shape.missing)
    return tuple(
        BoneLength(name, float(length), float(sigma))
        for (name, _, last), length, sigma in zip(BONES, length_m, sigma_m, strict=True)
        if not missing[JOINT_INDEX[last]]
    )


def _spans(asset: BodyAsset, shape: FittedShape) -> np.ndarray:
    """Return the vector (n, 3), metres, from the first to the second joint of each of ``BONES`` in the rest pose."""
    start, end = _ends(asset)
    heads = shape.mesh(asset).bone_heads
    return np.asarray(heads[end] - heads[start])


@cache
def _ends(asset: BodyAsset) -> tuple[np.ndarray, np.ndarray]:
    bones = joint_bones(asset)
    ends = np.array([[bones[JOINT_INDEX[start]], bones[JOINT_INDEX[end]]] for _, start, end in BONES])
    return ends[:, 0], ends[:, 1]
