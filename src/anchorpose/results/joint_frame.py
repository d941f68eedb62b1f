"""The answer for one frame: where each joint is, how that is known, and how far off it may be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.joints import JOINT_COUNT, JointState


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointFrame:
    """The 21 joints at one time of the reference clock, order of ``JOINT_NAMES``, world frame.

    position_m (21, 3) float64, NaN where lost; sigma_m (21,) float64, one standard deviation an axis, NaN where lost.
    Raises ValueError where position, sigma and state disagree: a lost joint has no numbers, any other has all of them.
    """

    frame: int
    time_s: float
    position_m: np.ndarray
    state: tuple[JointState, ...]
    sigma_m: np.ndarray

    def __post_init__(self) -> None:
        if self.position_m.shape != (JOINT_COUNT, 3) or self.sigma_m.shape != (JOINT_COUNT,):
            raise ValueError(f"position_m is {self.position_m.shape} and sigma_m {self.sigma_m.shape}, not 21 joints")
        if len(self.state) != JOINT_COUNT:
            raise ValueError(f"{len(self.state)} states given for {JOINT_COUNT} joints")
        lost = np.array([state is JointState.LOST for state in self.state])
        known = np.isfinite(self.position_m).all(axis=1) & np.isfinite(self.sigma_m) & (self.sigma_m > 0)
        blank = np.isnan(self.position_m).all(axis=1) & np.isnan(self.sigma_m)
        if not np.where(lost, blank, known).all():
            wrong = int(np.flatnonzero(~np.where(lost, blank, known))[0])
            raise ValueError(
                f"frame {self.frame}, joint {wrong}: position, sigma and state {self.state[wrong]} disagree"
            )
