"""From joint positions back to a pose: how predicted joints become part transforms (paper, Section IV).

Legs that were taken for each other: the skin fits as well, hips and knees do not.
"""

from __future__ import annotations

import numpy as np

from anchorpose.body.asset import joint_bones
from anchorpose.body.fit import FitConfig, limited, prior_equations
from anchorpose.body.pose import POSE_SIZE, Pose
from anchorpose.body.skin_points import Body, joint_jacobian, pose_points
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES

_JOINT_SIGMA_M = 0.01  # predicted joints are means of whole parts: closer than that they need not be met
_STEPS = 3


def pose_from_joints(body: Body, start: Pose, joints_m: np.ndarray, config: FitConfig) -> Pose:
    """The pose near ``start`` whose joints come closest to joints_m (21, 3); rows of NaN say nothing."""
    bones = joint_bones(body.points.asset)
    known = np.isfinite(joints_m).all(axis=1)
    nearby = np.diag(1.0 / config.process_variance(1.0))  # what the joints leave open stays as it was
    pose = start
    for _ in range(_STEPS):
        transforms = body.transforms(pose)
        at = body.mesh.joints(transforms)
        jacobian = joint_jacobian(body, transforms, bones[known], at[known]).reshape(-1, POSE_SIZE)
        error = (at[known] - joints_m[known]).ravel()
        hessian, gradient, _ = prior_equations(body.points, pose, (start, nearby), config)
        hessian += jacobian.T @ jacobian / _JOINT_SIGMA_M**2
        gradient += jacobian.T @ error / _JOINT_SIGMA_M**2
        pose = pose.moved(limited(-np.linalg.solve(hessian, gradient), config), body.points.moving)
    return pose


CROSSED_M = 0.05  # of the knees, seen from the pelvis: who stands or steps keeps them apart
_LEGS = tuple(
    [JOINT_INDEX[f"{joint}{side}"] for joint in ("Knee", "Ankle", "Foot")] for side in ("Left", "Right")
)  # fmt: skip


def uncrossed(body: Body, pose: Pose, config: FitConfig) -> Pose | None:
    """The pose with each leg where the other one is; None where the knees are not crossed."""
    posed = pose_points(body, pose)
    joints = body.mesh.joints(posed.transforms)
    right = posed.transforms[body.points.asset.bone("Hips"), :3, 2]
    left_leg, right_leg = _LEGS
    if (joints[right_leg[0]] - joints[left_leg[0]]) @ right > -CROSSED_M:
        return None
    wanted = np.full((len(JOINT_NAMES), 3), np.nan)
    kept = [JOINT_INDEX[name] for name in ("SpineBase", "HipLeft", "HipRight", "SpineMid", "SpineShoulder")]
    wanted[kept] = joints[kept]
    wanted[left_leg], wanted[right_leg] = joints[right_leg], joints[left_leg]
    start = pose.rotations.copy()
    for limb in ("UpLeg", "Leg", "Foot"):
        start[[body.points.asset.bone(f"{side}{limb}") for side in ("Left", "Right")]] = np.eye(3)
    found = Pose(start, pose.root_m)
    for _ in range(3):
        found = pose_from_joints(body, found, wanted, config)
    return found
