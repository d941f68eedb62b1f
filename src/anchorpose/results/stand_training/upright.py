"""Upright or not, frame by frame, with hysteresis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.results.posture import NOT_UPRIGHT, UNKNOWN, UPRIGHT
from anchorpose.results.stand_training.stance import Stance


@dataclass(frozen=True, slots=True, kw_only=True)
class UprightConfig:
    """Begins when all three are met, ends when one of the wider limits is passed; between them nothing changes.

    Thighs within 45 degrees of the vertical are how accelerometers tell standing from sitting (Skotte et al. 2014,
    doi:10.1123/jpah.2011-0347). Thighs alone would call kneeling upright, and a patient who hangs over a rail; the
    pelvis' height and the trunk say otherwise.
    """

    thigh_enter_deg: float = 40.0
    thigh_leave_deg: float = 45.0
    height_enter: float = 0.85  # of the leg's length: thigh and shank each about 30 degrees from the vertical
    height_leave: float = 0.80
    trunk_enter_deg: float = 45.0
    trunk_leave_deg: float = 50.0

    def __post_init__(self) -> None:
        if not 0 < self.thigh_enter_deg <= self.thigh_leave_deg or not 0 < self.trunk_enter_deg <= self.trunk_leave_deg:
            raise ValueError("the limits that end standing must not be narrower than those that begin it")
        if not 0 < self.height_leave <= self.height_enter:
            raise ValueError("height_leave must lie between 0 and height_enter")


def upright(stance: Stance, config: UprightConfig, shift: float = 0.0) -> np.ndarray:
    """(n,) int8: 1 upright, 0 not, -1 cannot be told: a joint is lost, or nothing decisive was seen since one was.

    shift: so many sigma are taken off what speaks against standing, to see what errors may change.
    """
    thigh = stance.thigh_deg - shift * stance.thigh_sigma_deg
    trunk = stance.trunk_deg - shift * stance.trunk_sigma_deg
    height = stance.height + shift * stance.height_sigma
    begins = (
        (thigh <= config.thigh_enter_deg) & (trunk <= config.trunk_enter_deg) & (height >= config.height_enter)
    )  # fmt: skip
    ends = (thigh > config.thigh_leave_deg) | (trunk > config.trunk_leave_deg) | (height < config.height_leave)
    return hold(begins, ends, np.isfinite(thigh + trunk + height))


def hold(begins: np.ndarray, ends: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(n,) int8: 1 from a frame that begins it to one that ends it, else 0; -1 until the first, and where not known."""
    state = np.full(len(known), UNKNOWN, dtype=np.int8)
    decisive = begins | ends | ~known
    last = np.maximum.accumulate(np.where(decisive, np.arange(len(known)), -1))
    some = last >= 0
    state[some] = np.where(~known[last[some]], UNKNOWN, np.where(begins[last[some]], UPRIGHT, NOT_UPRIGHT))
    return state
