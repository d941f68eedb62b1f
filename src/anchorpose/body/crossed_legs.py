"""Legs that were taken for each other: the skin fits as well, hips and knees do not."""

from __future__ import annotations

import numpy as np

from anchorpose.body.fit import FitConfig
from anchorpose.body.inverse_kinematics import pose_from_joints
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import RestPoints, SkinPoints, pose_points
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES

CROSSED_M = 0.05  # of the knees, seen from the pelvis: who stands or steps keeps them apart
_LEGS = tuple(
    [JOINT_INDEX[f"{joint}{side}"] for joint in ("Knee", "Ankle", "Foot")] for side in ("Left", "Right")
)  # fmt: skip


def uncrossed(points: SkinPoints, rest: RestPoints, pose: Pose, config: FitConfig) -> Pose | None:
    """The pose with each leg where the other one is; None where the knees are not crossed."""
    posed = pose_points(points, rest, pose)
    joints = rest.body.joints(posed.transforms)
    right = posed.transforms[points.asset.bone("Hips"), :3, 2]
    left_leg, right_leg = _LEGS
    if (joints[right_leg[0]] - joints[left_leg[0]]) @ right > -CROSSED_M:
        return None
    wanted = np.full((len(JOINT_NAMES), 3), np.nan)
    kept = [JOINT_INDEX[name] for name in ("SpineBase", "HipLeft", "HipRight", "SpineMid", "SpineShoulder")]
    wanted[kept] = joints[kept]
    wanted[left_leg], wanted[right_leg] = joints[right_leg], joints[left_leg]
    start = pose.rotations.copy()
    for limb in ("UpLeg", "Leg", "Foot"):
        start[[points.asset.bone(f"{side}{limb}") for side in ("Left", "Right")]] = np.eye(3)
    found = Pose(start, pose.root_m)
    for _ in range(3):
        found = pose_from_joints(points, rest, found, wanted, config)
    return found
