"""A pose that somebody who looked corrects: where some of its joints are, and how well he can tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.body.asset import joint_bones
from anchorpose.body.fit import FitConfig, limited, prior_equations
from anchorpose.body.pose import LIMB_OF_BONES, LIMB_OF_JOINTS, POSE_SIZE, TRUNK
from anchorpose.body.registration import PoseBelief
from anchorpose.body.skin_points import Body, joint_jacobian

_STEPS = 8  # a limb that was on the wrong side of the body has some way to go
CONTRADICTED = 3.8  # sigmas of both together: two in a thousand are farther off; then a wrong limb was seen


@dataclass(frozen=True, slots=True, eq=False)
class ToldJoints:
    """Joints of one frame: joint (k,) index into ``JOINT_NAMES``, position_m (k, 3) world, sigma_m (k,) an axis."""

    joint: np.ndarray
    position_m: np.ndarray
    sigma_m: np.ndarray


def contradicted(body: Body, belief: PoseBelief, told: ToldJoints) -> bool:
    """Whether a joint is farther from where it is told to be than the belief and the one who tells allow for."""
    at, jacobian = _joints(body, belief, told)
    variance = ((jacobian @ belief.covariance) * jacobian).sum(axis=(1, 2)) / 3.0 + told.sigma_m**2
    away_m = np.linalg.norm(at - told.position_m, axis=1)
    return bool((away_m > CONTRADICTED * np.sqrt(variance)).any())


def doubted(belief: PoseBelief, told: ToldJoints, elapsed_s: float, config: FitConfig) -> PoseBelief:
    """The belief as if the limbs of the told joints had not been seen for a time; trunk and other limbs stay sure."""
    growth = config.process_variance(elapsed_s)
    limbs = np.unique(LIMB_OF_JOINTS[told.joint])
    growth[:-3] *= np.repeat(np.isin(LIMB_OF_BONES, limbs), 3)
    growth[-3:] *= TRUNK in limbs
    information = np.linalg.inv(np.linalg.inv(belief.information) + np.diag(growth))
    return PoseBelief(belief.pose, belief.covariance + np.diag(growth), information)


def with_told(
    body: Body, belief: PoseBelief, told: ToldJoints, config: FitConfig,
    inflation: float = 1.0,
) -> PoseBelief:  # fmt: skip
    """The belief together with what was told: the most probable pose by both, bones of the same length as before.

    inflation: what sigma is made of the posterior by (``UncertaintyConfig``): the told sigma is to come out as told.
    """
    worth = np.repeat((told.sigma_m / inflation) ** -2, 3)
    expected, pose = (belief.pose, belief.information), belief.pose
    for _ in range(_STEPS):
        at, jacobian = _joints(body, PoseBelief(pose, belief.covariance, belief.information), told)
        rows = jacobian.reshape(-1, POSE_SIZE)
        hessian, gradient, _ = prior_equations(body.points, pose, expected, config)
        hessian += rows.T @ (worth[:, None] * rows)
        gradient += rows.T @ (worth * (at - told.position_m).ravel())
        pose = pose.moved(limited(-np.linalg.solve(hessian, gradient), config), body.points.moving)
    gained = rows.T @ (worth[:, None] * rows)
    return PoseBelief(pose, np.linalg.inv(hessian), belief.information + gained)


def _joints(body: Body, belief: PoseBelief, told: ToldJoints) -> tuple[np.ndarray, np.ndarray]:
    """(k, 3) where the told joints are by the belief, and (k, 3, POSE_SIZE) how the pose moves them."""
    transforms = body.transforms(belief.pose)
    at = body.mesh.joints(transforms)[told.joint]
    return at, joint_jacobian(body, transforms, joint_bones(body.points.asset)[told.joint], at)
