"""The frames that a reviewer should look at first, and why each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from anchorpose.joints import JOINT_NAMES
from anchorpose.results.tables import JointTable

APART_S: Final = 1.0  # two frames nearer than this show the same thing
MOST_OF_A_KIND: Final = 12
FEW_MATCHED: Final = 0.9  # the usual share on sound recordings is 0.95 to 1


@dataclass(frozen=True, slots=True)
class WorstFrame:
    """A row of the results to look at, its reason for people, and the joint it is about, if it is one."""

    position: int
    reason: str
    joint: int | None


def worst_frames(
    joints: JointTable, matched_share: np.ndarray, dropped: Sequence[dict[str, Any]]
) -> tuple[WorstFrame, ...]:
    """Lost joints first, then pictures that could not be used, few matches, and the largest sigma.

    matched_share (n,): NaN where nothing was asked. Each kind: the worst, then the worst a second away, and so on.
    """
    return (
        *_lost(joints),
        *_dropped(joints, dropped),
        *_unmatched(joints, matched_share),
        *_unsure(joints),
    )


def _lost(joints: JointTable) -> list[WorstFrame]:
    count = joints.lost.sum(axis=1)
    found = []
    for position in _apart(np.where(count > 0, count.astype(float), np.nan), joints.time_s):
        names = [JOINT_NAMES[joint] for joint in np.flatnonzero(joints.lost[position])]
        told = "all joints lost" if len(names) == len(JOINT_NAMES) else f"lost: {', '.join(names)}"
        found.append(WorstFrame(position, told, None))
    return found


def _dropped(joints: JointTable, dropped: Sequence[dict[str, Any]]) -> list[WorstFrame]:
    rows = {int(number): row for row, number in enumerate(joints.frame)}
    known = [drop for drop in dropped if drop["frame"] in rows]
    return [WorstFrame(rows[drop["frame"]], drop["why"], None) for drop in known[:MOST_OF_A_KIND]]


def _unmatched(joints: JointTable, share: np.ndarray) -> list[WorstFrame]:
    few = np.where(share < FEW_MATCHED, 1.0 - share, np.nan)
    return [
        WorstFrame(row, f"{100 * share[row]:.0f} % of the points found again in the next frame", None)
        for row in _apart(few, joints.time_s)
    ]


def _unsure(joints: JointTable) -> list[WorstFrame]:
    worst = np.where(np.isnan(joints.sigma_m), -np.inf, joints.sigma_m).max(axis=1)
    found = []
    for row in _apart(np.where(np.isfinite(worst), worst, np.nan), joints.time_s):
        joint = int(np.nanargmax(joints.sigma_m[row]))
        found.append(WorstFrame(row, f"{JOINT_NAMES[joint]}: sigma {1000 * joints.sigma_m[row, joint]:.0f} mm", joint))
    return found


def _apart(badness: np.ndarray, time_s: np.ndarray) -> list[int]:
    """Rows by falling badness, none within ``APART_S`` of a worse one; NaN is no candidate."""
    chosen: list[int] = []
    for row in np.argsort(-badness, kind="stable"):
        if np.isnan(badness[row]) or len(chosen) == MOST_OF_A_KIND:
            break
        if all(abs(time_s[row] - time_s[other]) >= APART_S for other in chosen):
            chosen.append(int(row))
    return chosen
