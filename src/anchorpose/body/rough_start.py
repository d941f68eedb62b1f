"""A rough first pose of somebody of whom nothing is known: any heading, standing, bent, reaching or squatting."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset
from anchorpose.body.constraints import surface_constraints
from anchorpose.body.evidence import Evidence
from anchorpose.body.fit import limited, pose_equations, solve_damped
from anchorpose.body.pose import DEGREE, Pose
from anchorpose.body.registration import RegistrationConfig
from anchorpose.body.skin_points import RestPoints, SkinPoints, pose_points

_POSTURES: Final = {
    "standing": {"LeftArm": (-25, 0, 0)},
    "bent": {"LowerBack": (0, 0, -25), "Spine": (0, 0, -20), "LeftUpLeg": (0, 0, 30), "LeftArm": (0, 0, 50)},
    "squatting": {"LeftUpLeg": (0, 0, 95), "LeftLeg": (0, 0, -110), "LeftArm": (0, 0, 40), "LowerBack": (0, 0, -15)},
}
"""Rotations about (X, Y, Z) in degrees from the rest pose; those of the left are mirrored for the right."""

_HEADINGS: Final = tuple(np.arange(8) * np.pi / 4)
_FIRST_M, _THEN_M, _LAST_M = (0.45, 0.35, 0.28), (0.25, 0.2, 0.2, 0.15), (0.12, 0.12, 0.10, 0.08)
_SECOND_ROUND, _THIRD_ROUND = 6, 2  # of the 24 starts that go on


def find_rough_pose(points: SkinPoints, rest: RestPoints, evidence: Evidence, config: RegistrationConfig) -> Pose:
    """The best of many starts, most of them given up early."""
    poses = [
        _placed(points, rest, pose, evidence)
        for heading in _HEADINGS
        for pose in _postures(points.asset, float(heading))
    ]
    few = replace(config, constraints=replace(config.constraints, node_count=250))
    for reaches, kept, settings in ((_FIRST_M, _SECOND_ROUND, few), (_THEN_M, _THIRD_ROUND, few), (_LAST_M, 1, config)):
        tried = [_settle(points, rest, pose, evidence, reaches, settings) for pose in poses]
        order = np.argsort([cost for _, cost in tried], kind="stable")
        poses = [tried[place][0] for place in order[:kept]]
    return poses[0]


def _settle(
    points: SkinPoints, rest: RestPoints, pose: Pose, evidence: Evidence, reaches_m: tuple[float, ...],
    config: RegistrationConfig,
) -> tuple[Pose, float]:  # fmt: skip
    for reach_m in reaches_m:
        posed = pose_points(points, rest, pose)
        rows = surface_constraints(posed, evidence.surface, evidence.cameras, reach_m, config.constraints)
        equations = pose_equations(points, rest, pose, posed, rows, None, config.fit)
        pose = pose.moved(limited(solve_damped(equations), config.fit), points.moving)
    posed = pose_points(points, rest, pose)
    rows = surface_constraints(posed, evidence.surface, evidence.cameras, reaches_m[-1], config.constraints)
    cost = pose_equations(points, rest, pose, posed, rows, None, config.fit).cost
    missing = min(len(evidence.surface), config.constraints.node_count) - len(rows)
    return pose, cost + missing * (
        reaches_m[-1] / 3.0 / config.constraints.surface_sigma_m
    ) ** 2 / config.fit.rows_per_observation


def _placed(points: SkinPoints, rest: RestPoints, pose: Pose, evidence: Evidence) -> Pose:
    seen = evidence.surface.points_m
    posed = pose_points(points, rest, pose).points_m
    middle = np.median(seen, axis=0)
    own = (posed.min(axis=0) + posed.max(axis=0)) / 2.0
    shift = middle - own
    shift[1] = seen[:, 1].max() - posed[:, 1].max()  # heads are seldom hidden, feet often
    return Pose(pose.rotations, pose.root_m + shift)


def _postures(asset: BodyAsset, heading: float) -> list[Pose]:
    poses = []
    for turns in _POSTURES.values():
        rotations = np.tile(np.eye(3), (len(asset.bone_names), 1, 1))
        rotations[asset.bone("Hips")] = Rotation.from_euler("y", heading).as_matrix()
        for bone, (x, y, z) in turns.items():
            for side, sign in (("Left", 1.0), ("Right", -1.0)) if bone.startswith("Left") else (("", 1.0),):
                angles = np.array([sign * x, sign * y, z]) * DEGREE
                rotations[asset.bone(bone.replace("Left", side) if side else bone)] = Rotation.from_rotvec(
                    angles
                ).as_matrix()
        poses.append(Pose(rotations, np.zeros(3)))
    return poses
