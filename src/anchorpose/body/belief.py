"""State what is known of a pose: the pose, its covariance, and how it becomes uncertain while time passes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.joint_ranges import turns_together
from anchorpose.body.pose import DEGREE, POSE_SIZE, Pose
from anchorpose.body.segments import load_body_asset

UNSEEN_S: Final = 4.0  # a limb that was not where it was expected is as uncertain as one unseen for so long


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """How fast a prediction becomes uncertain: a random walk about the predicted motion.

    turn_sigma, radians, and root_sigma_m: standard deviations after one second of each bone's turn and of the root.
    """

    turn_sigma: float
    root_sigma_m: float

    def variance(self, elapsed_s: float) -> np.ndarray:
        """Return (POSE_SIZE,) that a prediction gains over a time."""
        variance = np.full(POSE_SIZE, self.turn_sigma**2 * elapsed_s)
        variance[-3:] = self.root_sigma_m**2 * elapsed_s
        return variance


PATIENT_PACE: Final = Pace(turn_sigma=15.0 * DEGREE, root_sigma_m=0.08)
"""In 1/15 s a predicted limb strays by 4 degrees and a predicted trunk by 2 cm."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseBelief:
    """A pose and its uncertainty, in the parameters of ``Pose.moved``.

    covariance (POSE_SIZE, POSE_SIZE): of the pose, all knowledge together. information (POSE_SIZE, POSE_SIZE): of what
    was seen so far, without the joint range, which every frame adds again and which must not count twice.
    """

    pose: Pose
    covariance: np.ndarray
    information: np.ndarray

    def later(self, pose: Pose, elapsed_s: float, pace: Pace = PATIENT_PACE) -> PoseBelief:
        """Return the belief in a predicted pose: what is not seen becomes more uncertain with time."""
        return self.grown(pose, pace.variance(elapsed_s))

    def grown(self, pose: Pose, variance: np.ndarray) -> PoseBelief:
        """Return the belief in another pose, with an additional variance (POSE_SIZE,) of each parameter.

        Joints move together as they bend together: a hidden knee follows the hip that is seen to bend.
        """
        sigma = np.sqrt(variance)
        growth = sigma[:, None] * turns_together(load_body_asset()) * sigma
        return PoseBelief(pose, self.covariance + growth, np.linalg.inv(np.linalg.inv(self.information) + growth))


def vague_belief(pose: Pose) -> PoseBelief:
    """Return a pose of which nothing was seen yet: half a radian and a quarter of a metre."""
    variance = np.full(POSE_SIZE, 0.5**2)
    variance[-3:] = 0.25**2
    return PoseBelief(pose, np.diag(variance), np.diag(1.0 / variance))
