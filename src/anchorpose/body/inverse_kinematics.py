"""Find poses whose joints are at given places. The places are predicted (paper, Section V), proposed by a search, or
set by a reviewer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.asset import joint_bones
from anchorpose.body.belief import PATIENT_PACE, UNSEEN_S, PoseBelief
from anchorpose.body.fit import limited, prior_equations
from anchorpose.body.pose import LIMB_OF_BONES, LIMB_OF_JOINTS, POSE_SIZE, TRUNK, Pose
from anchorpose.body.skin_points import Body, joint_jacobian, place_variance

# m, assumed standard deviation of the given joint places; predicted joint places are means over whole body parts, so a
# closer fit to them is meaningless
JOINT_SIGMA_M: Final = 0.01
# maximum distance of a joint from its corrected place, divided by the combined sigma of joint and correction; random
# errors exceed this ratio in 1 of 400 cases, so the limb of a joint beyond this ratio counts as misplaced
CONTRADICTED: Final = 3.8
_STEPS: Final = 3  # number of solver steps if the start is close to the wanted pose
_CORRECTION_STEPS: Final = 8  # number of solver steps for a correction, since a limb may have to move across the body


def pose_from_joints(body: Body, start: Pose, joints_m: np.ndarray) -> Pose:
    """Return the pose near ``start`` whose joints come closest to joints_m (21, 3); a joint that is NaN may be
    anywhere.
    """
    bones = joint_bones(body.points.asset)
    known = np.isfinite(joints_m).all(axis=1)
    # with this prior, parameters that the joints do not determine keep their values in ``start``
    nearby = np.diag(1.0 / PATIENT_PACE.variance(1.0))
    pose = start
    for _ in range(_STEPS):
        transforms = body.transforms(pose)
        at = body.mesh.joints(transforms)
        jacobian = joint_jacobian(body, transforms, bones[known], at[known]).reshape(-1, POSE_SIZE)
        error = (at[known] - joints_m[known]).ravel()
        prior = prior_equations(body.points, pose, (start, nearby))
        hessian = prior.hessian + jacobian.T @ jacobian / JOINT_SIGMA_M**2
        gradient = prior.gradient + jacobian.T @ error / JOINT_SIGMA_M**2
        pose = pose.moved(limited(-np.linalg.solve(hessian, gradient)), body.points.moving)
    return pose


@dataclass(frozen=True, slots=True, eq=False)
class CorrectedJoints:
    """The joints that a reviewer placed in one frame."""

    joint: np.ndarray  # (k,) index into ``JOINT_NAMES``
    position_m: np.ndarray  # (k, 3) m, corrected place of each joint in the world
    sigma_m: np.ndarray  # (k,) m, standard deviation of each corrected place per axis


def contradicted(body: Body, belief: PoseBelief, corrected: CorrectedJoints) -> bool:
    """Return whether any joint of the pose is farther from its corrected place than the uncertainty of pose and
    correction allows.
    """
    at, jacobian = _joints(body, belief.pose, corrected)
    variance = place_variance(jacobian, belief.covariance) + corrected.sigma_m**2
    away_m = np.linalg.norm(at - corrected.position_m, axis=1)
    return bool((away_m > CONTRADICTED * np.sqrt(variance)).any())


def relax_limbs(belief: PoseBelief, corrected: CorrectedJoints) -> PoseBelief:
    """Return the belief in the same pose, but with added uncertainty of the limbs (or the trunk) to which the corrected
    joints belong, as if no camera had seen these parts for ``UNSEEN_S`` seconds.
    """
    growth = PATIENT_PACE.variance(UNSEEN_S)
    limbs = np.unique(LIMB_OF_JOINTS[corrected.joint])
    growth[:-3] *= np.repeat(np.isin(LIMB_OF_BONES, limbs), 3)
    growth[-3:] *= TRUNK in limbs
    return belief.grown(belief.pose, growth)


def apply_corrections(body: Body, belief: PoseBelief, corrected: CorrectedJoints, inflation: float = 1.0) -> PoseBelief:
    """Combine a belief with the corrected joints into the most probable pose; bones keep their lengths.

    inflation: factor that later converts the posterior's sigma to the reported sigma (``UncertaintyConfig``). The
    corrections are weighted so that the reported sigma of a corrected joint becomes the sigma that the reviewer gave.
    """
    worth = np.repeat((corrected.sigma_m / inflation) ** -2, 3)
    expected, pose = (belief.pose, belief.information), belief.pose
    for _ in range(_CORRECTION_STEPS):
        at, jacobian = _joints(body, pose, corrected)
        rows = jacobian.reshape(-1, POSE_SIZE)
        prior = prior_equations(body.points, pose, expected)
        hessian = prior.hessian + rows.T @ (worth[:, None] * rows)
        gradient = prior.gradient + rows.T @ (worth * (at - corrected.position_m).ravel())
        pose = pose.moved(limited(-np.linalg.solve(hessian, gradient)), body.points.moving)
    gained = rows.T @ (worth[:, None] * rows)
    return PoseBelief(pose, np.linalg.inv(hessian), belief.information + gained)


def _joints(body: Body, pose: Pose, corrected: CorrectedJoints) -> tuple[np.ndarray, np.ndarray]:
    """Return the corrected joints' places (k, 3) in a pose, and their derivative (k, 3, POSE_SIZE) by the pose."""
    transforms = body.transforms(pose)
    at = body.mesh.joints(transforms)[corrected.joint]
    return at, joint_jacobian(body, transforms, joint_bones(body.points.asset)[corrected.joint], at)
