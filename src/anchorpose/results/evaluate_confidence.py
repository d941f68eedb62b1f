"""Results that are wrong and do not show it: confident errors, and limbs that are wrong in plain view."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_INDEX, JOINT_NAMES
from anchorpose.recording.pairing import half_period_s
from anchorpose.results.tables import JointTable
from anchorpose.results.truth import Truth

FAR_M: Final = 0.10
"""A joint farther off than this is on another part of the body, or on nothing."""

CONFIDENT_SIGMAS: Final = 4.0
"""An error beyond this many of a joint's own sigmas: of calibrated axes one in 16 000 is."""

WRONG_M: Final = 0.15
"""Farther off than this, half a forearm, a joint says nothing about the patient, and its limb is wrong."""

PLAIN_VIEW: Final = 0.5
"""Least share of a limb's skin that one camera must see for the limb to be in plain view."""

_ENDS: Final = {"arm": ("Elbow", "Wrist", "Hand"), "leg": ("Knee", "Ankle", "Foot")}
_FREE: Final = {
    f"{limb}_{side.lower()}": tuple(f"{joint}{side}" for joint in joints)
    for limb, joints in _ENDS.items()
    for side in ("Left", "Right")
}
_TRUNK: Final = tuple(name for name in JOINT_NAMES if not any(name in joints for joints in _FREE.values()))

LIMBS_JUDGED: Final[Mapping[str, np.ndarray]] = {
    name: np.array([JOINT_INDEX[joint] for joint in joints])
    for name, joints in {**_FREE, "trunk_and_head": _TRUNK}.items()
}
"""The joints (k,) of each limb; shoulders and hips belong to the trunk."""


SEEN_SHARE: Final = 0.25
"""Share of the skin around a joint that one camera must see for the joint to be seen by the truth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WrongInView:
    """The longest time without a break in which a limb was wrong in plain view; start_s is None if it never was."""

    start_s: float | None
    seconds: float


def distance_m(joints: JointTable, truth_m: np.ndarray) -> np.ndarray:
    """(n, 21) from each joint to its true place, truth_m (n, 21, 3); NaN where either is."""
    distance: np.ndarray = np.linalg.norm(joints.position_m - truth_m, axis=2)
    return distance


def confident_errors(joints: JointTable, truth_m: np.ndarray) -> np.ndarray:
    """(n, 21) bool: joints over ``FAR_M`` off and outside ``CONFIDENT_SIGMAS`` of their own sigma on some axis.

    truth_m (n, 21, 3) metres, NaN where unknown. A lost joint, or one without a known truth, is not among them.
    """
    wrong = distance_m(joints, truth_m) > FAR_M  # False where either is NaN
    farthest = np.abs(joints.position_m - truth_m).max(axis=2)
    return np.asarray(wrong & (farthest > CONFIDENT_SIGMAS * joints.sigma_m))


def seen_joints(truth: Truth) -> np.ndarray | None:
    """(t, 21) bool: some camera sees enough of the skin around the joint; None where the truth does not say."""
    return None if truth.seen_share is None else np.asarray((truth.seen_share >= SEEN_SHARE).any(axis=2))


def in_plain_view(truth: Truth) -> dict[str, np.ndarray]:
    """For each limb (t,) bool: some camera sees most of it.

    By the mean of ``seen_share`` over the limb's joints, per camera. A truth without it only knows the frames that it
    calls occluded: in all others everything then counts as in plain view.
    """
    if truth.seen_share is None:
        return dict.fromkeys(LIMBS_JUDGED, ~truth.occluded)
    share = truth.seen_share.astype(np.float64)
    return {name: (share[:, limb].mean(axis=1) > PLAIN_VIEW).any(axis=1) for name, limb in LIMBS_JUDGED.items()}


def wrong_in_view(joints: JointTable, truth: Truth) -> tuple[tuple[str, WrongInView], ...]:
    """For each limb the longest time in which a joint of it was over ``WRONG_M`` off while it was in plain view.

    joints, truth: frames matched row by row. A lost joint is not off; a frame counts for one period of the recording.
    """
    off = distance_m(joints, truth.position_m) > WRONG_M
    visible = in_plain_view(truth)
    return tuple(
        (name, WrongInView(start_s=start_s, seconds=seconds))
        for name, limb in LIMBS_JUDGED.items()
        for start_s, seconds in (longest_run(off[:, limb].any(axis=1) & visible[name], joints.time_s),)
    )


def longest_run(flags: np.ndarray, time_s: np.ndarray) -> tuple[float | None, float]:
    """When the longest unbroken run of True begins, None without one, and how long it lasts; flags, time_s (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    period_s = 2.0 * half_period_s(time_s)
    start_s, seconds = None, 0.0
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        lasted = float(time_s[end - 1] - time_s[first] + period_s)
        if lasted > seconds:
            start_s, seconds = float(time_s[first]), lasted
    return start_s, seconds
