"""Describe the belief in a pose: the pose, its covariance, and how it becomes uncertain with time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.joint_ranges import turns_together
from anchorpose.body.pose import DEGREE, POSE_SIZE, Pose
from anchorpose.body.segments import load_body_asset

UNSEEN_S: Final = 4.0  # s; a limb that was not at its expected place is as uncertain as one unseen for this time


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """How fast a prediction becomes uncertain: a random walk about the predicted motion.

    turn_sigma, radians, and root_sigma_m: standard deviations of each bone's turn and of the root after one second.
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

    covariance (POSE_SIZE, POSE_SIZE): the pose's, from all knowledge. information (POSE_SIZE, POSE_SIZE): from all
    observations so far, without the joint range, which every frame adds again and which must not count twice.
    """

    pose: Pose
    covariance: np.ndarray
    information: np.ndarray

    def later(self, pose: Pose, elapsed_s: float, pace: Pace = PATIENT_PACE) -> PoseBelief:
        """Return the belief in a predicted pose: unseen parts become more uncertain with time."""
        return self.grown(pose, pace.variance(elapsed_s))

    def grown(self, pose: Pose, variance: np.ndarray) -> PoseBelief:
        """Return the belief in another pose, with more variance (POSE_SIZE,) of each parameter.

        The added variance is correlated as joints bend together: a hidden knee follows a hip that is seen to bend.
        """
        sigma = np.sqrt(variance)
        growth = sigma[:, None] * turns_together(load_body_asset()) * sigma
        return PoseBelief(pose, self.covariance + growth, np.linalg.inv(np.linalg.inv(self.information) + growth))


def vague_belief(pose: Pose) -> PoseBelief:
    """Return the belief in a pose before any observation: half a radian and a quarter of a metre uncertain."""
    variance = np.full(POSE_SIZE, 0.5**2)
    variance[-3:] = 0.25**2
    return PoseBelief(pose, np.diag(variance), np.diag(1.0 / variance))
