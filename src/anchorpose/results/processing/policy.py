"""What is done to the joints before angles are made of them: said by the user, written down with the result."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Final, Literal, get_args

Smoothing = Literal["none", "butterworth", "kalman"]
Filling = Literal["none", "linear", "spline"]

DEFAULT_CUTOFF_HZ: Final = 6.0
"""Usual for walking and standing (Winter, Biomechanics and Motor Control of Human Movement)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessingConfig:
    """How joints are smoothed and which gaps are filled; by default nothing is done.

    smooth: "butterworth" (zero lag, effective order four, ``cutoff_hz``) or "kalman" (Rauch, Tung and Striebel with the
    joints' sigma; ``jerk`` says how freely the acceleration changes). fill: "linear" or "spline" for gaps up to
    ``longest_gap_s``; longer ones stay.
    """

    smooth: Smoothing = "none"
    cutoff_hz: float = DEFAULT_CUTOFF_HZ
    jerk: float = 30.0  # m/s^3 times the square root of a second: a hand that reaches turns round within about 0.3 s
    fill: Filling = "none"
    longest_gap_s: float = 0.2  # about half the time in which a reaching hand turns round

    def __post_init__(self) -> None:
        if self.smooth not in get_args(Smoothing) or self.fill not in get_args(Filling):
            raise ValueError(f"unknown way to smooth ({self.smooth}) or to fill ({self.fill})")
        if not (0 < self.cutoff_hz < float("inf") and 0 < self.jerk < float("inf")):
            raise ValueError("cutoff_hz and jerk must be positive")
        if not 0 < self.longest_gap_s < float("inf"):
            raise ValueError("longest_gap_s must be positive")

    @property
    def asked_for(self) -> bool:
        """Whether anything is to be done."""
        return self.smooth != "none" or self.fill != "none"


def policy_text(config: ProcessingConfig, counts: dict[str, int]) -> str:
    """The policy as JSON, the settings that were not used left out; counts: what came of it."""
    settings = asdict(config)
    if config.smooth != "butterworth":
        del settings["cutoff_hz"]
    if config.smooth != "kalman":
        del settings["jerk"]
    if config.fill == "none":
        del settings["longest_gap_s"]
    return json.dumps(settings | counts, sort_keys=True)
