"""How far a result is from the truth, and whether its uncertainties are true to their word."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_NAMES, JointState
from anchorpose.recording.pairing import half_period_s, nearest_within
from anchorpose.results.angle_errors import NORMAL_95, AngleError, angle_errors
from anchorpose.results.contacts import CONTACTS_FILE, read_contacts
from anchorpose.results.evaluate_contacts import ContactEvaluation, TrueTouch, evaluate_contacts, read_true_touch
from anchorpose.results.joint_frame import SEVERITY
from anchorpose.results.off_track import OffTrack, longest_off
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.results.truth import Truth, read_truth

HIDDEN: Final = tuple(state for state in JointState if state not in (JointState.OBSERVED, JointState.LOST))
"""The states of a joint that is inferred."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorSummary:
    """Errors of some joints in some frames; None where there is nothing to take the mean of."""

    joint_frames: int  # joints times frames that the truth knows
    lost_share: float | None  # of joint_frames
    mean_mm: float | None  # the errors leave lost joints out
    median_mm: float | None
    p95_mm: float | None
    coverage_95: float | None  # share of axes on which the truth lies within 1.96 sigma; honest is 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """A result against the truth."""

    matched_frames: int
    truth_frames: int  # after the skipped start
    missing_frames: int  # truth frames for which the result has no frame
    overall: ErrorSummary
    per_joint: tuple[tuple[str, ErrorSummary], ...]
    per_state: tuple[tuple[str, ErrorSummary], ...]
    hidden: ErrorSummary  # joints that the result calls hidden, by whatever
    angles: tuple[tuple[str, AngleError], ...]
    longest_off: OffTrack  # how long a joint was another limb's, somebody else's or nowhere
    occluded_frames: ErrorSummary  # frames that the truth calls occluded
    clear_frames: ErrorSummary
    drift_ratio: float | None  # mean error of the second half of the frames over that of the first
    contacts: ContactEvaluation | None = None  # None where the truth or the result tells no contacts


def evaluate(results: Path, truth: Path, skip_s: float = 0.0) -> Evaluation:
    """Compares a results folder with a truth.npz, frames matched to the nearest time within half a period.

    The first ``skip_s`` seconds of the truth are left out. Raises InputError where a file cannot be used or the two
    share no time.
    """
    joints, known = read_joints(results / JOINTS_FILE), read_truth(truth)
    kept = known.time_s >= known.time_s[0] + skip_s
    if not kept.any():
        raise InputError(truth, f"ends before the {skip_s:g} s to be skipped", "skip less")
    known = Truth(known.time_s[kept], known.position_m[kept], known.occluded[kept])
    match = nearest_within(known.time_s, joints.time_s, half_period_s(known.time_s))
    if (match < 0).all():
        raise InputError(truth, f"shares no time with {results / JOINTS_FILE}", "give the truth of that recording")
    evaluation = compare(_frames(joints, match[match >= 0]), _truth_frames(known, match >= 0), truth_frames=len(match))
    touch = read_true_touch(truth)
    if touch is None or not (results / CONTACTS_FILE).exists():
        return evaluation
    touch = TrueTouch(touch.bones[kept][match >= 0], touch.names)
    contacts = evaluate_contacts(read_contacts(results / CONTACTS_FILE), joints.frame[match[match >= 0]], touch)
    return replace(evaluation, contacts=contacts)


def compare(joints: JointTable, truth: Truth, truth_frames: int) -> Evaluation:
    """The evaluation of frames (n) that are matched row by row, out of ``truth_frames``."""
    everything = np.ones(joints.severity.shape, dtype=bool)
    occluded = np.repeat(truth.occluded[:, None], JOINT_COUNT, axis=1)
    half = len(joints.frame) // 2
    first, second = (
        _summary(joints, truth, _rows(everything, 0, half)),
        _summary(joints, truth, _rows(everything, half)),
    )
    return Evaluation(
        matched_frames=len(joints.frame),
        truth_frames=truth_frames,
        missing_frames=truth_frames - len(joints.frame),
        overall=_summary(joints, truth, everything),
        per_joint=tuple(
            (name, _summary(joints, truth, everything & (np.arange(JOINT_COUNT) == index)))
            for index, name in enumerate(JOINT_NAMES)
        ),
        per_state=tuple(
            (str(state), _summary(joints, truth, joints.severity == SEVERITY[state])) for state in JointState
        ),
        hidden=_summary(joints, truth, np.isin(joints.severity, [SEVERITY[state] for state in HIDDEN])),
        angles=angle_errors(joints, truth.position_m),
        longest_off=longest_off(joints, truth.position_m),
        occluded_frames=_summary(joints, truth, occluded),
        clear_frames=_summary(joints, truth, ~occluded),
        drift_ratio=second.mean_mm / first.mean_mm if first.mean_mm and second.mean_mm is not None else None,
    )


def _summary(joints: JointTable, truth: Truth, chosen: np.ndarray) -> ErrorSummary:
    """The errors of the joint-frames where ``chosen`` (n, 21)."""
    chosen = chosen & np.isfinite(truth.position_m).all(axis=-1)
    found = chosen & ~joints.lost
    offset_m = joints.position_m[found] - truth.position_m[found]
    error_mm = 1000.0 * np.linalg.norm(offset_m, axis=-1)
    within = np.abs(offset_m) <= NORMAL_95 * joints.sigma_m[found][:, None]
    some = len(error_mm) > 0
    return ErrorSummary(
        joint_frames=int(chosen.sum()),
        lost_share=float(1.0 - found.sum() / chosen.sum()) if chosen.any() else None,
        mean_mm=float(error_mm.mean()) if some else None,
        median_mm=float(np.median(error_mm)) if some else None,
        p95_mm=float(np.percentile(error_mm, 95)) if some else None,
        coverage_95=float(within.mean()) if some else None,
    )


def _rows(chosen: np.ndarray, start: int, stop: int | None = None) -> np.ndarray:
    rows = np.zeros_like(chosen)
    rows[start:stop] = chosen[start:stop]
    return rows


def _frames(joints: JointTable, index: np.ndarray) -> JointTable:
    return JointTable(
        joints.frame[index],
        joints.time_s[index],
        joints.position_m[index],
        joints.severity[index],
        joints.sigma_m[index],
    )


def _truth_frames(truth: Truth, matched: np.ndarray) -> Truth:
    return Truth(truth.time_s[matched], truth.position_m[matched], truth.occluded[matched])
