"""Compute where joints are expected in a frame, and the cost of a pose whose joints are elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.asset import joint_bones
from anchorpose.body.belief import PoseBelief
from anchorpose.body.pose import LIMB_OF_JOINTS, PARTS
from anchorpose.body.skin_points import Body, joint_jacobian, place_variance

# m; two poses lead to the same registration if each joint moves by less than this from the first pose to the second
SAME_M: Final = 0.04


@dataclass(frozen=True, slots=True, eq=False)
class Expected:
    """The expected places of the body's joints: joints_m (21, 3) world, and their standard deviation sigma_m (21,)."""

    body: Body
    joints_m: np.ndarray
    sigma_m: np.ndarray

    def moved(self, joints_m: np.ndarray) -> float:
        """Return the cost, in nats, of the distance of joints (21, 3) from their expected places: the sum over the
        limbs and the trunk (``moved_parts``). A pose in which the body is turned round has the costs of all of them.
        """
        return float(self.moved_parts(joints_m).sum())

    def moved_parts(self, joints_m: np.ndarray) -> np.ndarray:
        """Return, for the trunk and each limb (PARTS,), the cost in nats of the distance of its farthest joint of
        joints_m (21, 3) from the expected place.

        The cost has the tails of a Cauchy distribution, since a wrongly tracked limb may be anywhere.
        """
        away = np.linalg.norm(joints_m - self.joints_m, axis=1) / self.sigma_m
        farthest = np.zeros(PARTS)
        np.maximum.at(farthest, LIMB_OF_JOINTS, away)
        return np.asarray(np.log1p(farthest**2))


def expected_joints(body: Body, belief: PoseBelief) -> Expected:
    """Return the places of the joints in a belief's pose, and the sigma of each place, which is at least ``SAME_M``."""
    transforms = body.transforms(belief.pose)
    joints = body.mesh.joints(transforms)
    jacobian = joint_jacobian(body, transforms, joint_bones(body.points.asset), joints)
    variance = place_variance(jacobian, belief.covariance)
    return Expected(body, joints, np.sqrt(SAME_M**2 + variance))
