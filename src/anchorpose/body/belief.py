"""Describe the belief in a pose: the pose, its covariance, and how it becomes uncertain with time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.joint_ranges import turns_together
from anchorpose.body.pose import DEGREE, LIMB_OF_BONES, POSE_SIZE, SEGMENT_OF_BONES, TRUNK, Pose
from anchorpose.body.segments import load_body_asset

UNSEEN_S: Final = 4.0  # s; a limb that was not at its expected place is as uncertain as one unseen for this time


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """The rate at which a prediction becomes uncertain, by a random walk about the predicted motion.

    turn_sigma (radians) and root_sigma_m: standard deviations of each bone's rotation and of the root's place after one
    second.
    """

    turn_sigma: float
    root_sigma_m: float

    def variance(self, elapsed_s: float) -> np.ndarray:
        """Return the variance (POSE_SIZE,) that a prediction gains over a time."""
        variance = np.full(POSE_SIZE, self.turn_sigma**2 * elapsed_s)
        variance[-3:] = self.root_sigma_m**2 * elapsed_s
        return variance


PATIENT_PACE: Final = Pace(turn_sigma=15.0 * DEGREE, root_sigma_m=0.08)
"""Pace of the patient: in 1/15 s a predicted limb strays by 4 degrees and a predicted trunk by 2 cm."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseBelief:
    """A pose and its uncertainty, in the parameters of ``Pose.moved``.

    covariance (POSE_SIZE, POSE_SIZE): covariance of the pose, from all knowledge. information (POSE_SIZE, POSE_SIZE):
    information from all observations so far, without the joint range, which every frame adds again and which must not
    count twice.
    """

    pose: Pose
    covariance: np.ndarray
    information: np.ndarray

    def later(self, pose: Pose, elapsed_s: float, pace: Pace = PATIENT_PACE) -> PoseBelief:
        """Return the belief in a predicted pose: unseen parts become more uncertain with time."""
        return self.grown(pose, pace.variance(elapsed_s))

    def grown(self, pose: Pose, variance: np.ndarray) -> PoseBelief:
        """Return the belief in another pose, with more variance (POSE_SIZE,) of each parameter.

        The added variance has the correlations of joints that bend together, so a hidden knee follows a hip that is
        seen to bend.
        """
        sigma = np.sqrt(variance)
        growth = sigma[:, None] * turns_together(load_body_asset()) * sigma
        return PoseBelief(pose, self.covariance + growth, np.linalg.inv(np.linalg.inv(self.information) + growth))


TRUNK_TURN, LIMB_TURN, ROOT_M_S = 15.0 * DEGREE, 37.0 * DEGREE, 0.18
"""How fast people leave the pose in which they were last seen: standard deviations about one axis of the turn of a
trunk and of a limb, radians per second, and along one axis of the root, metres per second. Measured over half a second:
trunks have turned by 11 degrees, thighs by 26, root mean square, and roots moved 0.09 m along each axis (UI-PRMD, ten
exercises by seven people)."""


def vague_belief(pose: Pose, unseen_s: np.ndarray | None = None) -> PoseBelief:
    """Return the belief in a pose before its frame is used, with standard deviations of half a radian and a quarter of
    a metre.

    unseen_s (PARTS, 2): seconds since each part of a limb, as in ``Likelihood``, was last seen. A hidden part is known
    from earlier frames, the better the less time has passed; infinite means that it was never seen. 0 (and None, for
    all parts) means that the frame shows the part and nothing is known from earlier frames.
    """
    sigma = np.full(POSE_SIZE, 0.5)
    sigma[-3:] = 0.25
    if unseen_s is not None:
        turned = unseen_s.ravel()[SEGMENT_OF_BONES] * np.where(LIMB_OF_BONES == TRUNK, TRUNK_TURN, LIMB_TURN)
        moved = np.concatenate([np.repeat(turned, 3), np.full(3, ROOT_M_S * unseen_s[TRUNK, 0])])
        sigma = np.where(moved > 0.0, np.minimum(sigma, moved), sigma)
    return PoseBelief(pose, np.diag(sigma**2), np.diag(sigma**-2.0))
