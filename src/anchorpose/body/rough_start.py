"""A rough first pose of somebody of whom nothing is known: any heading, standing, bent or squatting."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset
from anchorpose.body.constraints import surface_constraints
from anchorpose.body.evidence import Evidence, doubted_node_cost
from anchorpose.body.fit import limited, pose_equations, solve_damped
from anchorpose.body.pose import DEGREE, Pose
from anchorpose.body.registration import RegistrationConfig
from anchorpose.body.skin_points import RestPoints, SkinPoints, pose_points

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


def find_rough_pose(points: SkinPoints, rest: RestPoints, evidence: Evidence, config: RegistrationConfig) -> Pose:
    """The pose in which the body explains the nodes best, of many starts."""
    coarse = replace(config, constraints=replace(config.constraints, node_count=_FEW_NODES))
    poses = [_placed(points, rest, pose, evidence) for pose in _starts(points.asset)]
    for number, (reaches_m, kept) in enumerate(_ROUNDS):
        settings = config if number == len(_ROUNDS) - 1 else coarse
        tried = [_settle(points, rest, pose, evidence, reaches_m, settings) for pose in poses]
        cheapest = np.argsort([cost for _, cost in tried], kind="stable")[:kept]
        poses = [tried[place][0] for place in cheapest]
    return poses[0]


def _settle(
    points: SkinPoints, rest: RestPoints, pose: Pose, evidence: Evidence, reaches_m: Sequence[float],
    config: RegistrationConfig,
) -> tuple[Pose, float]:  # fmt: skip
    """A few steps of registration, and how badly the pose then explains the nodes."""
    for reach_m in (*reaches_m, reaches_m[-1]):
        posed = pose_points(points, rest, pose)
        rows = surface_constraints(posed, evidence.surface, evidence.cameras, reach_m, config.constraints)
        equations = pose_equations(points, rest, pose, posed, rows, None, config.fit)
        settled, pose = pose, pose.moved(limited(solve_damped(equations), config.fit), points.moving)
    missing = min(len(evidence.surface), config.constraints.node_count) - len(rows)
    return settled, equations.cost + missing * doubted_node_cost(reaches_m[-1], config.constraints, config.fit)


def _placed(points: SkinPoints, rest: RestPoints, pose: Pose, evidence: Evidence) -> Pose:
    """The pose with its middle over the middle of what is seen, its top at the top: heads are seldom hidden."""
    seen, own = evidence.surface.points_m, pose_points(points, rest, pose).points_m
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
