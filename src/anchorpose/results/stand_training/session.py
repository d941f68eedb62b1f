"""What the measures of a recording are computed from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.joints import LOST
from anchorpose.results.records import SIT_TO_STAND, STAND_TO_SIT, Contact, Episode
from anchorpose.results.stand_training.stance import Stance
from anchorpose.results.tables import UPRIGHT, AngleTable, JointTable, PostureTable


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """Of the same frames: joints, angles, posture, stance; seconds (n,) that each frame stands for.

    contacts: None where the results folder has no table of them.
    """

    joints: JointTable
    angles: AngleTable
    posture: PostureTable
    stance: Stance
    seconds: np.ndarray
    episodes: tuple[Episode, ...]
    contacts: tuple[Contact, ...] | None

    @property
    def upright(self) -> np.ndarray:
        """(n,) bool: known to be upright."""
        return self.posture.upright == UPRIGHT

    @property
    def standing(self) -> np.ndarray:
        """(n,) bool: upright, and neither just standing up nor just sitting down."""
        return self.upright & ~self.moving()

    def moving(self, settle_s: float = 0.0) -> np.ndarray:
        """(n,) bool: inside a change between sitting and standing, without its two end frames, or settle_s after it."""
        time_s, changing = self.joints.time_s, np.zeros(len(self.seconds), dtype=bool)
        for episode in self.episodes:
            if episode.kind in (SIT_TO_STAND, STAND_TO_SIT):
                changing |= (time_s > episode.start_s) & (time_s < episode.end_s + settle_s)
        return changing

    @property
    def found(self) -> np.ndarray:
        """(n,) bool: any joint of the patient was found. In other frames contacts are unknown."""
        found: np.ndarray = self.joints.state_code.min(axis=1) < LOST
        return found


def inferred_share(state_code: np.ndarray) -> float | None:
    """Share of frames in which the worst joint used, state_code (k,), was not seen; None for no frames."""
    return float(np.mean(state_code > 0)) if len(state_code) else None
