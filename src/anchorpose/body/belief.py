"""Describe the belief in a pose: the pose, its covariance, and how it becomes uncertain with time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.joint_ranges import turns_together
from anchorpose.body.pose import DEGREE, LIMB_OF_BONES, POSE_SIZE, SEGMENT_OF_BONES, TRUNK, Pose
from anchorpose.body.segments import load_body_asset

UNSEEN_S: Final = 4.0  # s; a limb that was not at its expected place is as uncertain as a limb unseen for this time


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """The rate at which a prediction becomes uncertain: people deviate from it by a random walk."""

    turn_sigma: float  # rad, standard deviation of each bone's rotation after one second
    root_sigma_m: float  # m, standard deviation of the root's place after one second

    def variance(self, elapsed_s: float) -> np.ndarray:
        """Return the variance (POSE_SIZE,) that a prediction gains in ``elapsed_s``."""
        variance = np.full(POSE_SIZE, self.turn_sigma**2 * elapsed_s)
        variance[-3:] = self.root_sigma_m**2 * elapsed_s
        return variance


PATIENT_PACE: Final = Pace(turn_sigma=15.0 * DEGREE, root_sigma_m=0.08)
"""Pace of the patient: in 1/15 s a predicted limb strays by 4 degrees and a predicted trunk by 2 cm."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseBelief:
    """A pose and its uncertainty, in the parameters of ``Pose.moved``."""

    pose: Pose
    covariance: np.ndarray  # (POSE_SIZE, POSE_SIZE) covariance of the pose, from all knowledge
    # (POSE_SIZE, POSE_SIZE) information from all observations so far. The joint range is not included, since every
    # frame adds it again and it must not count twice.
    information: np.ndarray

    def later(self, pose: Pose, elapsed_s: float, pace: Pace = PATIENT_PACE) -> PoseBelief:
        """Return the belief in a predicted pose ``elapsed_s`` later, with the uncertainty gained since then."""
        return self.grown(pose, pace.variance(elapsed_s))

    def grown(self, pose: Pose, variance: np.ndarray) -> PoseBelief:
        """Return the belief in another pose, with the given variance (POSE_SIZE,) added to each parameter.

        The added variance is correlated between joints that bend together, so that a hidden knee bends with a visible
        hip.
        """
        sigma = np.sqrt(variance)
        growth = sigma[:, None] * turns_together(load_body_asset()) * sigma
        return PoseBelief(pose, self.covariance + growth, np.linalg.inv(np.linalg.inv(self.information) + growth))


TRUNK_TURN, LIMB_TURN, ROOT_M_S = 15.0 * DEGREE, 37.0 * DEGREE, 0.18
"""How fast people leave the pose in which they were last seen. These are standard deviations, each about or along one
axis: turn of a trunk and of a limb, radians per second; movement of the root, metres per second. In half a second,
trunks turn by 11 degrees and thighs by 26 (root mean square), and roots move 0.09 m along each axis (measured in
UI-PRMD, ten exercises by seven people)."""


def vague_belief(pose: Pose, unseen_s: np.ndarray | None = None) -> PoseBelief:
    """Return the belief in a pose before its frame is used, with standard deviations of half a radian and a quarter of
    a metre.

    unseen_s (PARTS, 2): seconds since each part of a limb (as in ``Likelihood``) was last seen; the shorter this time,
    the better earlier frames determine a hidden part. inf: the part was never seen. 0: this frame shows the part, and
    earlier frames are not used. None: 0 for all parts.
    """
    sigma = np.full(POSE_SIZE, 0.5)
    sigma[-3:] = 0.25
    if unseen_s is not None:
        turned = unseen_s.ravel()[SEGMENT_OF_BONES] * np.where(LIMB_OF_BONES == TRUNK, TRUNK_TURN, LIMB_TURN)
        moved = np.concatenate([np.repeat(turned, 3), np.full(3, ROOT_M_S * unseen_s[TRUNK, 0])])
        sigma = np.where(moved > 0.0, np.minimum(sigma, moved), sigma)
    return PoseBelief(pose, np.diag(sigma**2), np.diag(sigma**-2.0))
