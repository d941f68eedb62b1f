"""Describe the belief in a pose: the most probable pose, its covariance, and how the covariance grows with time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.joint_ranges import turns_together
from anchorpose.body.pose import DEGREE, LIMB_OF_BONES, POSE_SIZE, SEGMENT_OF_BONES, TRUNK, Pose
from anchorpose.body.segments import load_body_asset

# s; if a predicted pose proves wrong, its uncertainty is increased as if no camera had seen the patient for this time
UNSEEN_S: Final = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """The rate at which a predicted pose becomes uncertain: the true pose is assumed to depart from the predicted pose
    by a random walk.
    """

    turn_sigma: float  # rad, standard deviation of each bone's turn from the predicted pose after one second, per axis
    # m, standard deviation of the pelvis's movement from its predicted place after one second, per axis
    root_sigma_m: float

    def variance(self, elapsed_s: float) -> np.ndarray:
        """Return the variance (POSE_SIZE,) that each parameter of a predicted pose gains in ``elapsed_s`` seconds."""
        variance = np.full(POSE_SIZE, self.turn_sigma**2 * elapsed_s)
        variance[-3:] = self.root_sigma_m**2 * elapsed_s
        return variance


PATIENT_PACE: Final = Pace(turn_sigma=15.0 * DEGREE, root_sigma_m=0.08)
"""The rate (``Pace``) at which a predicted pose of the patient becomes uncertain. For example, after 1/15 s the added
sigma per axis is 4 degrees (bones) and 2 cm (pelvis)."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseBelief:
    """A pose and its uncertainty. Both matrices have a row and a column per parameter of a pose change
    (``Pose.moved``).
    """

    pose: Pose
    # (POSE_SIZE, POSE_SIZE) covariance of the pose, given all observations and the prior knowledge of joint angles
    covariance: np.ndarray
    # (POSE_SIZE, POSE_SIZE) inverse covariance of the pose, given all observations so far. Prior knowledge of joint
    # angles is not included: every frame adds this knowledge again, so it would count several times.
    information: np.ndarray

    def later(self, pose: Pose, elapsed_s: float, pace: Pace = PATIENT_PACE) -> PoseBelief:
        """Return the belief in ``pose``, which is predicted for ``elapsed_s`` seconds later; ``pace`` gives the
        variance to add.
        """
        return self.grown(pose, pace.variance(elapsed_s))

    def grown(self, pose: Pose, variance: np.ndarray) -> PoseBelief:
        """Return the belief in another pose, with the given variance (POSE_SIZE,) added to the variance of each
        parameter.

        The added variance is correlated between joints that people bend together. So if images show that a hip bends,
        the hidden knee of the same leg is estimated to bend, too.
        """
        sigma = np.sqrt(variance)
        growth = sigma[:, None] * turns_together(load_body_asset()) * sigma
        return PoseBelief(pose, self.covariance + growth, np.linalg.inv(np.linalg.inv(self.information) + growth))


TRUNK_TURN, LIMB_TURN, ROOT_M_S = 15.0 * DEGREE, 37.0 * DEGREE, 0.18
"""Standard deviations of people's movement away from the pose in which they were last seen, per second. In this order:
turn of a trunk bone about each axis (rad/s), turn of a limb bone about each axis (rad/s), and movement of the pelvis
along each axis (m/s). Measured in UI-PRMD (ten exercises by seven people): in half a second, trunks turn by 11 degrees
and thighs by 26 (root mean square), and the pelvis moves 0.09 m along each axis."""


def vague_belief(pose: Pose, unseen_s: np.ndarray | None = None) -> PoseBelief:
    """Return the belief in a frame's pose before the images of this frame are used. The standard deviation is half a
    radian for each bone's turn about each axis, and a quarter of a metre for the pelvis along each axis; it is less for
    parts that earlier frames showed.

    unseen_s (PARTS, 2): seconds since each part was last seen. Row 0 is the trunk. Its columns are the lower trunk, and
    the chest with neck and head. Each other row is a limb. Its columns are the part above the elbow or knee, and the
    part below. The shorter the time since a part was last seen, the smaller the part's standard deviation. The value
    inf means that the part was never seen. The value 0 means that this frame shows the part; such a part has the full
    standard deviation, as if no earlier frame had shown it. If ``unseen_s`` is None, this frame counts as showing all
    parts.
    """
    sigma = np.full(POSE_SIZE, 0.5)
    sigma[-3:] = 0.25
    if unseen_s is not None:
        turned = unseen_s.ravel()[SEGMENT_OF_BONES] * np.where(LIMB_OF_BONES == TRUNK, TRUNK_TURN, LIMB_TURN)
        moved = np.concatenate([np.repeat(turned, 3), np.full(3, ROOT_M_S * unseen_s[TRUNK, 0])])
        sigma = np.where(moved > 0.0, np.minimum(sigma, moved), sigma)
    return PoseBelief(pose, np.diag(sigma**2), np.diag(sigma**-2.0))
