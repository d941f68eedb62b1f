"""The first pose and a first guess of the shape, from the anchors and the surface; nobody clicks anything.

A rough first pose of somebody of whom nothing is known: any heading, standing, bent or squatting.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset
from anchorpose.body.constraints import ConstraintConfig, Constraints, join, place_constraints, surface_constraints
from anchorpose.body.evidence import Evidence, doubted_node_cost, evidence_cost, evidence_rows
from anchorpose.body.fit import (
    FitConfig,
    ShapeFrame,
    learn_shape_step,
    limited,
    pose_equations,
    solve_damped,
)
from anchorpose.body.pose import DEGREE, Pose
from anchorpose.body.registration import RegistrationConfig
from anchorpose.body.shape_belief import ShapeBelief
from anchorpose.body.skin_points import Body, FittedShape, SkinPoints, build_body, pose_points
from anchorpose.geodesics.anchors import Anchors, no_anchors
from anchorpose.surface.surface import Surface

# Rotations about (X, Y, Z) in degrees that make a starting pose from the rest pose; mirrored for the right side.
_STARTS = {
    "standing": {},
    "arms down": {"LeftArm": (-25, 0, 0)},
    "arms forward": {"LeftArm": (0, 0, 40)},
    "arms up": {"LeftArm": (80, 0, 0)},
    "sitting": {"LeftUpLeg": (0, 0, 80), "LeftLeg": (0, 0, -80)},
}
_ANNEALING_M = (0.40, 0.40, 0.30, 0.30, 0.25, 0.25, 0.20, 0.20, 0.15, 0.15, 0.15, 0.12, 0.12, 0.12)
_TRIAL_STEPS = 6  # every start gets so many, the finalists the rest
_TRIAL_NODES = 800  # a third of the nodes tell a good start from a bad one
_FINALISTS = 3
_ANCHOR_STEPS = 6
_RIGID_SHAPE_REACH_M = 0.28  # nearer, the shape may give way too: a wrong height would pull limbs into false places


@dataclass(frozen=True, slots=True, eq=False)
class FirstPose:
    """The best of several starts; cost is per constraint, comparable between frames."""

    pose: Pose
    shape: FittedShape
    start: str
    cost: float


def find_first_pose(
    points: SkinPoints, evidence: Evidence, anchors: Anchors, shapes: Sequence[FittedShape], known: ShapeBelief,
    shape_known: bool, config: ConstraintConfig, fit_config: FitConfig, turns: Sequence[float] = (0.0,),
) -> FirstPose:  # fmt: skip
    """Register bodies from several starting poses, with the anchors and without, and keep the cheapest.

    A hole can make an anchor of the wrong limb's end, and a start that is held by it ends nowhere.
    shapes : the patient's learnt shape, or guesses that may still change (``shape_of_height``) where shape_known is
    False, within what is ``known`` of it. turns : headings to try, radians about the world's Y; 0 faces X.
    """
    trial = replace(config, node_count=min(config.node_count, _TRIAL_NODES))
    starts = [
        _settle(points, FirstPose(_placed(points, shape, pose, evidence.surface), shape, name, np.inf), evidence,
                held, _ANNEALING_M[:_TRIAL_STEPS], known, shape_known, trial, fit_config)
        for shape in shapes
        for name, pose in _starting_poses(points.asset, turns)
        for held in ((anchors, no_anchors()) if anchors.found.any() else (anchors,))
    ]  # fmt: skip
    best = sorted(starts, key=lambda first: first.cost)[:_FINALISTS]
    found = [
        _settle(points, first, evidence, no_anchors(), _ANNEALING_M[_TRIAL_STEPS:], known, shape_known, config,
                fit_config)
        for first in best
    ]  # fmt: skip
    return min(found, key=lambda first: first.cost)


def _settle(
    points: SkinPoints, first: FirstPose, evidence: Evidence, anchors: Anchors, reaches_m: Sequence[float],
    known: ShapeBelief, shape_known: bool, config: ConstraintConfig, fit_config: FitConfig,
) -> FirstPose:  # fmt: skip
    """Anchors place the tips, then the surface draws the body in, with less and less reach."""
    pose, shape = first.pose, first.shape
    body = build_body(points, shape)
    held = anchor_constraints(points, anchors)
    for _ in range(_ANCHOR_STEPS if len(held) else 0):
        posed = pose_points(body, pose)
        equations = pose_equations(body, pose, posed, held, None, fit_config)
        pose = pose.moved(limited(solve_damped(equations), fit_config), points.moving)
    for reach_m in reaches_m:
        rows = join([evidence_rows(body, pose, evidence, reach_m, config), held])
        if shape_known or reach_m > _RIGID_SHAPE_REACH_M:
            posed = pose_points(body, pose)
            equations = pose_equations(body, pose, posed, rows, None, fit_config)
            pose = pose.moved(limited(solve_damped(equations), fit_config), points.moving)
        else:
            learned, (pose,) = learn_shape_step(points, shape, [ShapeFrame(pose, rows)], known, fit_config)
            shape = learned.shape
            body = build_body(points, shape)
    cost = evidence_cost(body, pose, evidence, reaches_m[-1], config, fit_config) + known.cost(shape)
    return FirstPose(pose, shape, first.start, cost)


def _placed(points: SkinPoints, shape: FittedShape, pose: Pose, surface: Surface) -> Pose:
    """Move the root so that the middle of the body lies at the middle of what is seen."""
    body = build_body(points, shape)
    posed = pose_points(body, pose)
    middle = (np.percentile(surface.points_m, 2, axis=0) + np.percentile(surface.points_m, 98, axis=0)) / 2.0
    own = (posed.points_m.min(axis=0) + posed.points_m.max(axis=0)) / 2.0
    return Pose(pose.rotations, pose.root_m + middle - own)


def _starting_poses(asset: BodyAsset, turns: Sequence[float]) -> list[tuple[str, Pose]]:
    poses = []
    for turn in turns:
        for name, left in _STARTS.items():
            rotations = np.tile(np.eye(3), (len(asset.bone_names), 1, 1))
            rotations[asset.bone("Hips")] = Rotation.from_euler("y", turn).as_matrix()
            for bone, (x, y, z) in left.items():
                for side, sign in (("Left", 1.0), ("Right", -1.0)):
                    angles = np.array([sign * x, sign * y, z]) * DEGREE
                    rotations[asset.bone(bone.replace("Left", side))] = Rotation.from_rotvec(angles).as_matrix()
            poses.append((name, Pose(rotations, np.zeros(3))))
    return poses


@cache
def anchor_points(asset: BodyAsset, points: SkinPoints) -> np.ndarray:
    """(5,) skin points at the tips that the anchors lie on, in the order of ``ANCHOR_NAMES``."""
    place = asset.vertices[points.vertex]
    names = np.array(asset.bone_names)[points.part]
    tips = []
    for words, axis in (
        (("Head",), (0, 1, 0)),
        (("LeftHand", "LeftFingerBase", "LeftHandFinger1"), None),
        (("RightHand", "RightFingerBase", "RightHandFinger1"), None),
        (("LeftFoot", "LeftToeBase"), (1, 0, 0)),
        (("RightFoot", "RightToeBase"), (1, 0, 0)),
    ):
        mine = np.flatnonzero(np.isin(names, words))
        reach = place[mine] @ np.array(axis) if axis else np.abs(place[mine] @ np.array([0.4, -0.4, 0.0])
                                                                 ) + np.abs(place[mine, 2])  # fmt: skip
        tips.append(mine[reach.argmax()])
    return np.array(tips)


def anchor_constraints(points: SkinPoints, anchors: Anchors, sigma_m: float = 0.05) -> Constraints:
    """The anchors that were found hold the tips; sigma is the paper's bound on their localisation (Section V)."""
    found = anchors.found
    return place_constraints(
        anchor_points(points.asset, points)[found], anchors.position_m[found], sigma_m, 5.0 * sigma_m
    )


def shape_of_height(asset: BodyAsset, height_m: float) -> FittedShape:
    """The most likely adult of a height: along the coefficient that changes it, clothes of ordinary thickness."""
    coefficients = np.zeros(asset.shape_count)
    per_unit = np.ptp(asset.vertices[:, 1] + asset.vertex_basis[0, :, 1]) - np.ptp(asset.vertices[:, 1])
    coefficients[0] = np.clip((height_m - np.ptp(asset.vertices[:, 1])) / per_unit, -2.5, 2.5)
    return FittedShape(coefficients, 0.006)


_POSTURES: Final = (
    {"Arm": (-25, 0, 0)},  # upright, arms hang down
    {"LowerBack": (0, 0, -25), "Spine": (0, 0, -20), "UpLeg": (0, 0, 30), "Arm": (0, 0, 50)},  # bent forward
    {"LowerBack": (0, 0, -15), "UpLeg": (0, 0, 95), "Leg": (0, 0, -110), "Arm": (0, 0, 40)},  # squatting
)
"""Turns about X, Y and Z of the rest pose in degrees, limbs' of the left side; the right side's are mirrored."""

_HEADINGS: Final = tuple(np.arange(8) * np.pi / 4)

_ROUNDS: Final = (((0.45, 0.35, 0.28), 6), ((0.25, 0.20, 0.20, 0.15), 2), ((0.12, 0.12, 0.10, 0.08), 1))
"""The reach of each step, metres, and how many starts go on: most are given up early."""

_FEW_NODES: Final = 250  # of all rounds but the last: enough to tell a back from a front


def find_rough_pose(body: Body, evidence: Evidence, config: RegistrationConfig) -> Pose:
    """The pose in which the body explains the nodes best, of many starts."""
    coarse = replace(config, constraints=replace(config.constraints, node_count=_FEW_NODES))
    poses = [_placed_roughly(body, pose, evidence) for pose in _starts(body.points.asset)]
    for number, (reaches_m, kept) in enumerate(_ROUNDS):
        settings = config if number == len(_ROUNDS) - 1 else coarse
        tried = [_settle_roughly(body, pose, evidence, reaches_m, settings) for pose in poses]
        cheapest = np.argsort([cost for _, cost in tried], kind="stable")[:kept]
        poses = [tried[place][0] for place in cheapest]
    return poses[0]


def _settle_roughly(
    body: Body, pose: Pose, evidence: Evidence, reaches_m: Sequence[float],
    config: RegistrationConfig,
) -> tuple[Pose, float]:  # fmt: skip
    """A few steps of registration, and how badly the pose then explains the nodes."""
    for reach_m in (*reaches_m, reaches_m[-1]):
        posed = pose_points(body, pose)
        rows = surface_constraints(posed, evidence.surface, evidence.cameras, reach_m, config.constraints)
        equations = pose_equations(body, pose, posed, rows, None, config.fit)
        settled, pose = pose, pose.moved(limited(solve_damped(equations), config.fit), body.points.moving)
    missing = min(len(evidence.surface), config.constraints.node_count) - len(rows)
    return settled, equations.cost + missing * doubted_node_cost(reaches_m[-1], config.constraints, config.fit)


def _placed_roughly(body: Body, pose: Pose, evidence: Evidence) -> Pose:
    """The pose with its middle over the middle of what is seen, its top at the top: heads are seldom hidden."""
    seen, own = evidence.surface.points_m, pose_points(body, pose).points_m
    shift = np.median(seen, axis=0) - (own.min(axis=0) + own.max(axis=0)) / 2.0
    shift[1] = seen[:, 1].max() - own[:, 1].max()
    return Pose(pose.rotations, pose.root_m + shift)


def _starts(asset: BodyAsset) -> Iterator[Pose]:
    """Every posture in every heading, the root in the world's origin."""
    for heading in _HEADINGS:
        for posture in _POSTURES:
            rotations = np.tile(np.eye(3), (len(asset.bone_names), 1, 1))
            rotations[asset.bone("Hips")] = Rotation.from_euler("y", heading).as_matrix()
            for name, (x, y, z) in posture.items():
                sides = ((name, 1),) if name in asset.bone_names else ((f"Left{name}", 1), (f"Right{name}", -1))
                for bone, sign in sides:
                    turn = Rotation.from_rotvec(np.array([sign * x, sign * y, z]) * DEGREE)
                    rotations[asset.bone(bone)] = turn.as_matrix()
            yield Pose(rotations, np.zeros(3))
