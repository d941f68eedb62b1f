"""How long a joint was somewhere else: on another limb, on another person, or nowhere near."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_NAMES
from anchorpose.recording.pairing import half_period_s
from anchorpose.results.tables import JointTable

OFF_M: Final = 0.15
"""A joint so far from where it is says nothing about the patient any more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OffTrack:
    """The longest time without a break in which a joint was more than ``OFF_M`` off; no joint where none ever was."""

    joint: str | None
    start_s: float | None
    seconds: float


def longest_off(joints: JointTable, truth_m: np.ndarray) -> OffTrack:
    """Over all joints; truth_m (n, 21, 3) metres, NaN where unknown. A frame in which the joint is lost ends the time.

    A frame stands for one period of the recording.
    """
    off = np.linalg.norm(joints.position_m - truth_m, axis=2) > OFF_M  # False where either is NaN
    period_s = 2.0 * half_period_s(joints.time_s)
    longest = OffTrack(joint=None, start_s=None, seconds=0.0)
    for column, name in enumerate(JOINT_NAMES):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], off[:, column], [False]])))
        for first, end in zip(edges[::2], edges[1::2], strict=True):
            seconds = float(joints.time_s[end - 1] - joints.time_s[first] + period_s)
            if seconds > longest.seconds:
                longest = OffTrack(joint=name, start_s=float(joints.time_s[first]), seconds=seconds)
    return longest
