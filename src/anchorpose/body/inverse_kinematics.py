"""From joint positions back to a pose: how predicted joints become part transforms (paper, Section IV)."""

from __future__ import annotations

import numpy as np

from anchorpose.body.asset import joint_bones
from anchorpose.body.fit import FitConfig, limited, prior_equations
from anchorpose.body.pose import POSE_SIZE, Pose
from anchorpose.body.skin_points import RestPoints, SkinPoints, joint_jacobian

_JOINT_SIGMA_M = 0.01  # predicted joints are means of whole parts: closer than that they need not be met
_STEPS = 3


def pose_from_joints(
    points: SkinPoints, rest: RestPoints, start: Pose, joints_m: np.ndarray, config: FitConfig
) -> Pose:
    """The pose near ``start`` whose joints come closest to joints_m (21, 3); rows of NaN say nothing."""
    bones = joint_bones(points.asset)
    known = np.isfinite(joints_m).all(axis=1)
    nearby = np.diag(1.0 / config.process_variance(1.0))  # what the joints leave open stays as it was
    pose = start
    for _ in range(_STEPS):
        transforms = rest.body.bone_transforms(pose.rotations, pose.root_m)
        at = rest.body.joints(transforms)
        jacobian = joint_jacobian(points, rest, transforms, bones[known], at[known]).reshape(-1, POSE_SIZE)
        error = (at[known] - joints_m[known]).ravel()
        hessian, gradient, _ = prior_equations(points, pose, (start, nearby), config)
        hessian += jacobian.T @ jacobian / _JOINT_SIGMA_M**2
        gradient += jacobian.T @ error / _JOINT_SIGMA_M**2
        pose = pose.moved(limited(-np.linalg.solve(hessian, gradient), config), points.moving)
    return pose
