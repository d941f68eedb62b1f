"""Compare tracked results with the truth of a recording: errors of joints and angles, whether the stated sigmas fit
these errors, large errors with a small sigma (confident errors), and contacts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES, STATE_CODE, JointState
from anchorpose.recording.recording import half_period_s, nearest_within
from anchorpose.results.contact_scores import ContactEvaluation, score_contacts
from anchorpose.results.frame_table import cut_rows
from anchorpose.results.frame_time import runs_of, usual_step_s
from anchorpose.results.joint_angles import ANGLE_NAMES, joint_angles
from anchorpose.results.records import CONTACTS_FILE
from anchorpose.results.revolute_joints import REVOLUTE_JOINTS, revolute_axes
from anchorpose.results.session_scores import SessionEvaluation, score_session
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.results.trial_table import TRIALS_FILE
from anchorpose.results.truth import WRONG_M, Truth, read_truth, require_same_world
from anchorpose.results.uncertainty import NORMAL_95
from anchorpose.results.verify import require_own

FAR_M: Final = 0.10
"""Minimum error in m of a confident error (``CONFIDENT_SIGMAS``); with a smaller error, a joint is still on the right
body part.
"""

CONFIDENT_SIGMAS: Final = 4.0
"""A confident error exceeds this multiple of the joint's stated sigma along at least one axis. If the sigmas are right,
an error along an axis exceeds this multiple once in 16 000 cases.
"""

PLAIN_VIEW: Final = 0.5
"""Minimum share of a limb's skin that one camera must see for the limb to count as in plain view."""

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
"""By limb, indices (k,) of the joints whose errors count as errors of the limb; shoulders and hips count as
``trunk_and_head``.
"""


SEEN_SHARE: Final = 0.25
"""Minimum share of the skin around a joint that one camera must see for the joint to count as truly seen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LongestError:
    """The longest-lasting error of a limb or of a joint. For a limb, this is the longest unbroken time in which the
    limb was in plain view while one of its joints was over ``WRONG_M`` from its true place. For a joint, it is the
    longest unbroken time in which the joint was over ``WRONG_M`` from its true place. joint: name of the joint, None
    for a limb; start_s: time at which the error began. Both are None if no such error occurred.
    """

    joint: str | None = None
    start_s: float | None = None
    seconds: float = 0.0


def distance_m(joints: JointTable, truth_m: np.ndarray) -> np.ndarray:
    """Return the distances (n, 21) of the joints from their true places truth_m (n, 21, 3); NaN where either place is
    NaN.
    """
    return np.linalg.norm(joints.position_m - truth_m, axis=2)


def confident_errors(joints: JointTable, truth_m: np.ndarray) -> np.ndarray:
    """Return (n, 21) bool: joints that are more than ``FAR_M`` from their true place, and along some axis by more than
    ``CONFIDENT_SIGMAS`` times their stated sigma.

    truth_m (n, 21, 3): true positions of the joints in metres, NaN where unknown. The value is False for a lost joint,
    and for a joint whose truth is unknown.
    """
    wrong = distance_m(joints, truth_m) > FAR_M  # False where either position is NaN
    farthest = np.abs(joints.position_m - truth_m).max(axis=2)
    return np.asarray(wrong & (farthest > CONFIDENT_SIGMAS * joints.sigma_m))


def seen_joints(truth: Truth) -> np.ndarray | None:
    """Return (t, 21) bool: whether some camera sees at least ``SEEN_SHARE`` of the skin around the joint; None if the
    truth does not state which skin each camera sees.
    """
    return None if truth.seen_share is None else np.asarray((truth.seen_share >= SEEN_SHARE).any(axis=2))


def in_plain_view(truth: Truth) -> dict[str, np.ndarray]:
    """Return, per limb, (t,) bool: whether some camera sees most of the limb: the mean of ``truth.seen_share`` over the
    limb's joints exceeds ``PLAIN_VIEW``.

    A truth without ``seen_share`` only states which frames are occluded; in all other frames every limb then counts as
    in plain view.
    """
    if truth.seen_share is None:
        return dict.fromkeys(LIMBS_JUDGED, ~truth.occluded)
    share = truth.seen_share.astype(np.float64)
    return {name: (share[:, limb].mean(axis=1) > PLAIN_VIEW).any(axis=1) for name, limb in LIMBS_JUDGED.items()}


def wrong_in_view(joints: JointTable, truth: Truth) -> tuple[tuple[str, LongestError], ...]:
    """Return, per limb, the longest time in which the limb was in plain view while one of its joints was over
    ``WRONG_M`` from the joint's true place.

    Row i of joints and row i of truth belong to the same frame. A lost joint does not count as wrong. The longest time
    includes its last frame, which lasts the usual time between two frames.
    """
    off = distance_m(joints, truth.position_m) > WRONG_M
    visible = in_plain_view(truth)
    return tuple(
        (name, _longest_run(off[:, limb].any(axis=1) & visible[name], joints.time_s))
        for name, limb in LIMBS_JUDGED.items()
    )


def _longest_run(flags: np.ndarray, time_s: np.ndarray, joint: str | None = None) -> LongestError:
    """Return the longest unbroken run of True in ``flags`` (n,), which states whether ``joint`` (or, if None, a limb)
    is wrong in each frame. time_s (n,): times of the frames.
    """
    period_s = 2.0 * half_period_s(time_s)
    found = [
        LongestError(joint=joint, start_s=float(time_s[run.start]), seconds=float(np.ptp(time_s[run]) + period_s))
        for run in runs_of(flags)
    ]
    return max(found, key=lambda run: run.seconds, default=LongestError())


LEAST_SHARE: Final = 0.1
"""Minimum number of frames that results and truth have in common, as a share of the frames of the shorter of the two.
Fewer frames may match by chance, for example if times are in another unit. A truth for every thirtieth frame is
accepted, since all of its frames match.
"""


def longest_off(joints: JointTable, truth_m: np.ndarray) -> LongestError:
    """Return the longest-lasting error of all joints; truth_m (n, 21, 3): their true positions in metres, NaN where
    unknown.

    A frame in which the joint is lost ends the error. The error includes its last frame, which lasts the usual time
    between two frames.
    """
    off = distance_m(joints, truth_m) > WRONG_M  # False where either position is NaN
    runs = (_longest_run(off[:, column], joints.time_s, name) for column, name in enumerate(JOINT_NAMES))
    return max(runs, key=lambda run: run.seconds)


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleError:
    """The error of one angle. If no frame has both the angle and its truth, ``frames`` is 0 and all other fields are
    None.
    """

    frames: int
    mean_abs_deg: float | None
    p95_deg: float | None
    coverage_95: float | None  # share of frames in which the truth lies within 1.96 sigma; ideally 0.95


def angle_errors(joints: JointTable, truth_m: np.ndarray) -> tuple[tuple[str, AngleError], ...]:
    """Return each angle's error; truth_m (n, 21, 3) true joints, metres, of the frames of ``joints``, NaN where
    unknown.
    """
    found, exact = joint_angles(joints), np.zeros_like(joints.sigma_m)
    true = joint_angles(replace(joints, position_m=truth_m, sigma_m=exact))
    away = np.radians(found.degrees - true.degrees)
    error = np.degrees(np.abs(np.arctan2(np.sin(away), np.cos(away))))
    within = error <= NORMAL_95 * found.sigma_deg
    return tuple((name, _angle_summary(error[:, column], within[:, column])) for column, name in enumerate(ANGLE_NAMES))


def axis_errors(joints: JointTable, truth_m: np.ndarray) -> tuple[tuple[str, AngleError], ...]:
    """Return the error of the axis of rotation of each knee and elbow: its angle to the axis that is computed from the
    true joints. truth_m (n, 21, 3): the true joints in metres, NaN where unknown.
    """
    found = revolute_axes(joints)
    true = revolute_axes(replace(joints, position_m=truth_m, sigma_m=np.zeros_like(joints.sigma_m)))
    error = np.degrees(np.arccos(np.clip((found.axis * true.axis).sum(axis=2), -1.0, 1.0)))
    within = error <= NORMAL_95 * found.sigma_deg
    return tuple(
        (name, _angle_summary(error[:, column], within[:, column])) for column, name in enumerate(REVOLUTE_JOINTS)
    )


def _angle_summary(error_deg: np.ndarray, within: np.ndarray) -> AngleError:
    known, covered = error_deg[np.isfinite(error_deg)], within[np.isfinite(error_deg)]
    return AngleError(
        frames=len(known),
        mean_abs_deg=_mean(known),
        p95_deg=float(np.percentile(known, 95)) if len(known) else None,
        coverage_95=_mean(covered),
    )


def _mean(values: np.ndarray) -> float | None:
    """Return the mean of the values; None without values."""
    return float(values.mean()) if len(values) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorSummary:
    """The errors of some joints in some frames; a field is None if no joint position exists from which it can be
    computed.
    """

    joint_frames: int  # number of joint positions whose truth is known
    lost_share: float | None  # share of ``joint_frames`` that are lost
    mean_mm: float | None  # mean distance from the true place; here and below, lost joints are left out
    median_mm: float | None
    p95_mm: float | None
    coverage_95: float | None  # share of coordinates (x, y, z) whose truth is within 1.96 sigma; ideally 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """The comparison of a results folder with the truth."""

    matched_frames: int
    truth_frames: int  # number of frames of the truth after the skipped start
    results_frames: int  # number of frames of the results after the skipped start
    missing_frames: int  # number of truth frames without a matching frame in the results
    overall: ErrorSummary
    per_joint: tuple[tuple[str, ErrorSummary], ...]
    per_state: tuple[tuple[str, ErrorSummary], ...]
    observed: ErrorSummary  # joints that the result calls observed
    hidden: ErrorSummary  # joints that the result infers: neither observed nor lost
    # joints that some camera truly sees; None if the truth does not state what each camera sees
    truly_seen: ErrorSummary | None
    # joints that no camera truly sees; None if the truth does not state what each camera sees
    truly_hidden: ErrorSummary | None
    confident_errors: float | None  # share of overall.joint_frames with a confident error
    # share of the joint positions without a true position (patient away, limb missing) for which the results report a
    # position; no other field counts these joint positions; None if every joint has a true position
    reported_absent_share: float | None
    angles: tuple[tuple[str, AngleError], ...]
    axes: tuple[tuple[str, AngleError], ...]  # errors of the axes of knees and elbows
    wrong_in_view: tuple[tuple[str, LongestError], ...]  # by limb: its longest error while in plain view
    # whether the truth states what each camera saw; if not, limbs count as in plain view except in occluded frames
    view_known: bool
    longest_off: LongestError  # longest unbroken time in which one joint was far from its true place
    occluded_frames: ErrorSummary  # frames that the truth calls occluded
    clear_frames: ErrorSummary
    # mean error in the second half of the frames, divided by the mean error in the first half
    drift_ratio: float | None
    # contacts with people; None if truth or result does not state such contacts
    contacts: ContactEvaluation | None = None
    # contacts with equipment; None if truth or result does not state such contacts, or if tracking did not search for
    # them
    supports: ContactEvaluation | None = None
    session: SessionEvaluation | None = None  # None if the truth is not that of a simulated session


def evaluate(results: Path, truth: Path, skip_s: float = 0.0) -> Evaluation:
    """Compare a results folder with a truth.npz. Each frame of the truth is matched to the frame of the results that is
    nearest in time, if the two frames are at most half of the truth's frame interval apart.

    The first ``skip_s`` seconds of the truth are left out. Raises InputError if a file cannot be used, or results and
    truth have too few times in common.
    """
    require_own(results, (JOINTS_FILE, CONTACTS_FILE, TRIALS_FILE))
    joints, known = read_joints(results / JOINTS_FILE), read_truth(truth)
    kept = known.time_s >= known.time_s[0] + skip_s
    if not kept.any():
        raise InputError(truth, f"ends before the {skip_s:g} s to be skipped", "skip less")
    known = cut_rows(known, kept)
    match = nearest_within(known.time_s, joints.time_s, half_period_s(known.time_s))
    frames = int((joints.time_s >= joints.time_s[0] + skip_s).sum())
    _require_same_unit(truth, known.time_s, joints.time_s)
    _require_compared(truth, known, match, frames)
    joints, known = joints.frames(match[match >= 0]), cut_rows(known, match >= 0)
    require_same_world(truth, joints.position_m, known.position_m)
    evaluation, rows = compare(joints, known, len(match), frames), np.flatnonzero(kept)[match >= 0]
    evaluation = replace(evaluation, session=score_session(results, truth, joints, known.position_m, rows))
    if not (results / CONTACTS_FILE).exists():
        return evaluation
    contacts, supports = score_contacts(results / CONTACTS_FILE, truth, joints.frame, rows)
    return replace(evaluation, contacts=contacts, supports=supports)


CLOSER: Final = 10.0
"""The truth's times count as in another unit if the truth's frame interval and its duration are both smaller than in
the results, by more than this factor. For a truth in minutes, both are 60 times smaller.
"""


def _require_same_unit(path: Path, truth_s: np.ndarray, results_s: np.ndarray) -> None:
    """Raise InputError if the truth's times are in minutes or hours. A truth in seconds is accepted even if it has
    fewer frames than the results, or covers a shorter time.
    """
    if min(len(truth_s), len(results_s)) < 2:
        return
    steps, spans = ((each(results_s) / each(truth_s)) for each in (usual_step_s, np.ptp))
    if min(steps, spans) > CLOSER:
        problem = f"has frames {steps:.3g} times closer than the results, as where its times are in minutes"
        raise InputError(path, problem, "write seconds")


def _require_compared(path: Path, truth: Truth, match: np.ndarray, results_frames: int) -> None:
    """Raise InputError if too few frames are matched (``LEAST_SHARE``), or no joint has a true position in them."""
    found = match >= 0
    if found.sum() < LEAST_SHARE * min(len(match), results_frames) or not found.any():
        problem = (
            f"shares the times of only {found.sum()} of {results_frames} frames of the results, as where its times are "
            "in another unit or of another clock"
        )
        raise InputError(path, problem, "give the truth of that recording, with the times of its frames in seconds")
    if not np.isfinite(truth.position_m[found]).all(axis=-1).any():
        problem = f"has no position of any joint in the {found.sum()} frames that it shares with the results"
        raise InputError(path, problem, "give a truth with the joints of that recording")


def compare(joints: JointTable, truth: Truth, truth_frames: int, results_frames: int) -> Evaluation:
    """Return the evaluation of matched frames: row i of joints and row i of truth are the same frame. truth_frames,
    results_frames: number of frames of the truth and of the results, matched or not.
    """
    errors, seen, codes = _errors(joints, truth.position_m), seen_joints(truth), joints.state_code
    observed = codes == STATE_CODE[JointState.OBSERVED]
    occluded, frames = truth.occluded[:, None], np.arange(len(joints.frame))[:, None]
    first, second = (_summary(errors, half) for half in (frames < len(frames) // 2, frames >= len(frames) // 2))
    return Evaluation(
        matched_frames=len(joints.frame),
        truth_frames=truth_frames,
        results_frames=results_frames,
        missing_frames=truth_frames - len(joints.frame),
        overall=_summary(errors, np.array(True)),
        per_joint=tuple(
            (name, _summary(errors, np.arange(JOINT_COUNT) == index)) for index, name in enumerate(JOINT_NAMES)
        ),
        per_state=tuple((str(state), _summary(errors, codes == STATE_CODE[state])) for state in JointState),
        observed=_summary(errors, observed),
        hidden=_summary(errors, ~observed & ~joints.lost),
        truly_seen=None if seen is None else _summary(errors, seen),
        truly_hidden=None if seen is None else _summary(errors, ~seen),
        confident_errors=_mean(confident_errors(joints, truth.position_m)[errors.known]),
        reported_absent_share=_mean(~joints.lost[~errors.known]),
        angles=angle_errors(joints, truth.position_m),
        axes=axis_errors(joints, truth.position_m),
        wrong_in_view=wrong_in_view(joints, truth),
        view_known=seen is not None,
        longest_off=longest_off(joints, truth.position_m),
        occluded_frames=_summary(errors, occluded),
        clear_frames=_summary(errors, ~occluded),
        drift_ratio=second.mean_mm / first.mean_mm if first.mean_mm and second.mean_mm is not None else None,
    )


class _Errors(NamedTuple):
    """The errors of all joints. error_mm (n, 21); within (n, 21, 3) bool: axes on which the truth lies within 1.96
    sigma of the tracked place. known (n, 21) bool: joints with a true place; found (n, 21) bool: known joints that are
    not lost.
    """

    error_mm: np.ndarray
    within: np.ndarray
    known: np.ndarray
    found: np.ndarray


def _errors(joints: JointTable, truth_m: np.ndarray) -> _Errors:
    within = np.abs(joints.position_m - truth_m) <= NORMAL_95 * joints.sigma_m[..., None]
    known = np.isfinite(truth_m).all(axis=-1)
    return _Errors(1000.0 * distance_m(joints, truth_m), within, known, known & ~joints.lost)


def _summary(errors: _Errors, chosen: np.ndarray) -> ErrorSummary:
    """Summarise the errors of the joints and frames that are ``chosen``, a mask that is broadcast to (n, 21)."""
    chosen, found = chosen & errors.known, chosen & errors.found
    error_mm, within = errors.error_mm[found], errors.within[found]
    some = len(error_mm) > 0
    return ErrorSummary(
        joint_frames=int(chosen.sum()),
        lost_share=float(1.0 - found.sum() / chosen.sum()) if chosen.any() else None,
        mean_mm=_mean(error_mm),
        median_mm=float(np.median(error_mm)) if some else None,
        p95_mm=float(np.percentile(error_mm, 95)) if some else None,
        coverage_95=_mean(within),
    )
