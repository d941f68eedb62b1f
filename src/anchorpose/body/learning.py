"""The patient's shape: what is known of it, how frames add to it, and the bone lengths that follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import Constraints
from anchorpose.body.evidence import Evidence, evidence_rows
from anchorpose.body.fit import limited, pose_equations
from anchorpose.body.pose import POSE_SIZE, Pose
from anchorpose.body.skin_points import FittedShape, SkinPoints, build_body, pose_points
from anchorpose.joints import JOINT_INDEX

REACHES_M: Final = (0.12, 0.10, 0.10, 0.08, 0.08, 0.06, 0.06, 0.06)  # of each step
CLOTHING_MEAN_M: Final = 0.006  # clothes are some millimetres thick
CLOTHING_SIGMA_M: Final = 0.004
MOST_DEVIATIONS: Final = 3.0  # of a coefficient: one adult in a thousand
THICKEST_M: Final = 0.03  # clothes
_HEIGHT_STEPS: Final = 3  # the highest and the lowest vertex may change with the shape


@dataclass(frozen=True, slots=True, eq=False)
class ShapeBelief:
    """The most likely shape, and information (k + 1, k + 1): inverse covariance of its coefficients, then clothing."""

    shape: FittedShape
    information: np.ndarray

    def deviation(self, shape: FittedShape) -> np.ndarray:
        """(k + 1,) how far a shape is from the most likely one."""
        return _vector(shape) - _vector(self.shape)

    def cost(self, shape: FittedShape) -> float:
        """How unlikely a shape is, in units of one observation."""
        away = self.deviation(shape)
        return float(away @ self.information @ away)

    def variance(self, rows: np.ndarray) -> np.ndarray:
        """(n,) variances of quantities that change with the coefficients by rows (n, k)."""
        covariance = np.linalg.inv(self.information)[:-1, :-1]
        return np.asarray(((rows @ covariance) * rows).sum(axis=1))

    def standing(self, asset: BodyAsset, height_m: float, sigma_m: float) -> ShapeBelief:
        """The belief after the patient's standing height was measured (a Kalman update, linearised at each step)."""
        shape, information = self.shape, self.information
        for _ in range(_HEIGHT_STEPS):
            own_m, row = standing_height(asset, shape)
            row = np.append(row, 0.0) / sigma_m
            miss = (height_m - own_m) / sigma_m + row @ self.deviation(shape)
            information = self.information + np.outer(row, row)
            mean = _vector(self.shape) + np.linalg.solve(information, row * miss)
            shape = FittedShape(mean[:-1], float(mean[-1]))
        return ShapeBelief(possible_shape(shape), information)


def adult_belief(asset: BodyAsset) -> ShapeBelief:
    """What is known of an adult before anything is seen: each coefficient has a standard deviation of one."""
    mean = FittedShape(np.zeros(asset.shape_count), CLOTHING_MEAN_M)
    return ShapeBelief(mean, np.diag(np.append(np.ones(asset.shape_count), 1.0 / CLOTHING_SIGMA_M**2)))


def possible_shape(shape: FittedShape) -> FittedShape:
    """The shape, held within what adults and their clothes can be: bad depth must not make a giant."""
    return FittedShape(
        np.clip(shape.coefficients, -MOST_DEVIATIONS, MOST_DEVIATIONS),
        float(np.clip(shape.clothing_m, 0.0, THICKEST_M)),
    )


def standing_height(asset: BodyAsset, shape: FittedShape) -> tuple[float, np.ndarray]:
    """Height in metres of the body at rest, without clothes, and its derivative (k,) by the coefficients."""
    up = shape.mesh(asset).vertices[:, 1]
    top, bottom = up.argmax(), up.argmin()
    count = len(shape.coefficients)
    row = asset.vertex_basis[:count, top, 1] - asset.vertex_basis[:count, bottom, 1]
    return float(up[top] - up[bottom]), row


def shape_of_height(asset: BodyAsset, height_m: float) -> FittedShape:
    """The most likely adult of a height: along the coefficient that changes it, clothes of ordinary thickness."""
    coefficients = np.zeros(asset.shape_count)
    per_unit = np.ptp(asset.vertices[:, 1] + asset.vertex_basis[0, :, 1]) - np.ptp(asset.vertices[:, 1])
    coefficients[0] = np.clip((height_m - np.ptp(asset.vertices[:, 1])) / per_unit, -2.5, 2.5)
    return FittedShape(coefficients, CLOTHING_MEAN_M)


def _vector(shape: FittedShape) -> np.ndarray:
    return np.append(shape.coefficients, shape.clothing_m)


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


@dataclass(frozen=True, slots=True, eq=False)
class ShapeFrame:
    """One frame that takes part in learning the shape: its pose so far and its constraints."""

    pose: Pose
    constraints: Constraints


def learn_shape_step(
    points: SkinPoints,
    shape: FittedShape,
    frames: Sequence[ShapeFrame],
    known: ShapeBelief,
    rows_per_observation: float,
) -> tuple[ShapeBelief, list[Pose]]:
    """One Gauss-Newton step on the shape that all frames share and on every frame's pose (Schur complement).

    known: what is known without these frames. Returns what is known with them, linearised at ``shape``, and the poses.
    """
    body = build_body(points, shape)
    count = len(shape.coefficients)
    size = count + 1
    schur, right = known.information.copy(), known.information @ known.deviation(shape)
    eliminated = []
    for frame in frames:
        posed = pose_points(body, frame.pose)
        equations = pose_equations(body, frame.pose, posed, frame.constraints, None, rows_per_observation, count)
        h, g = equations.hessian, equations.gradient
        factor = cho_factor(h[:POSE_SIZE, :POSE_SIZE] + 1e-3 * np.diag(np.diag(h)[:POSE_SIZE]))
        cross = cho_solve(factor, h[:POSE_SIZE, POSE_SIZE:])
        alone = cho_solve(factor, g[:POSE_SIZE])
        schur += h[POSE_SIZE:, POSE_SIZE:] - h[POSE_SIZE:, :POSE_SIZE] @ cross
        right += g[POSE_SIZE:] - h[POSE_SIZE:, :POSE_SIZE] @ alone
        eliminated.append((cross, alone))
    change = -np.linalg.solve(schur, right)
    poses = [
        frame.pose.moved(limited(-alone - cross @ change), points.moving)
        for frame, (cross, alone) in zip(frames, eliminated, strict=True)
    ]
    learned = FittedShape(shape.coefficients + change[:count], shape.clothing_m + change[size - 1])
    return ShapeBelief(possible_shape(learned), schur), poses


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
    heads = shape.mesh(asset).bone_heads
    return np.asarray(heads[end] - heads[start])


@cache
def _ends(asset: BodyAsset) -> tuple[np.ndarray, np.ndarray]:
    bones = joint_bones(asset)
    ends = np.array([[bones[JOINT_INDEX[start]], bones[JOINT_INDEX[end]]] for _, start, end in BONES])
    return ends[:, 0], ends[:, 1]
