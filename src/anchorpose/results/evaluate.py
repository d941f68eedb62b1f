"""How far a result is from the truth, and whether its uncertainties are true to their word.

The truth of a simulated recording, as ``evaluate`` compares results with it.

How long a joint was somewhere else: on another limb, on another person, or nowhere near.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES, STATE_CODE, JointState
from anchorpose.recording.pairing import half_period_s, nearest_within
from anchorpose.results.evaluate_tables import (
    AngleError,
    ContactEvaluation,
    TrueTouch,
    angle_errors,
    evaluate_contacts,
    read_true_touch,
)
from anchorpose.results.records import CONTACTS_FILE, read_contacts
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.results.uncertainty import NORMAL_95


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True joints: time_s (t,), position_m (t, 21, 3) world, NaN where not known; occluded (t,) bool."""

    time_s: np.ndarray
    position_m: np.ndarray
    occluded: np.ndarray


def read_truth(path: Path) -> Truth:
    """A truth.npz with ``joints`` (t, n, 3), ``names`` (n), ``time`` (t) and perhaps ``occluded`` (t).

    Joints may come in any order and some may be missing (NaN). Raises InputError where that is not what it holds.
    """
    remedy = "give a truth.npz with joints (t, 21, 3), names (21) and time (t)"
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in ("joints", "names", "time", "occluded") if name in file.files}
    except FileNotFoundError:
        raise InputError(path, "there is no such file", "check the path of the truth") from None
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, AttributeError) as error:
        raise InputError(path, f"cannot be read ({str(error).splitlines()[0][:80]})", remedy) from None
    missing = [name for name in ("joints", "names", "time") if name not in arrays]
    if missing:
        raise InputError(path, f"has no array '{missing[0]}'", remedy)
    joints, names, time_s = arrays["joints"], [str(name) for name in arrays["names"].ravel()], arrays["time"]
    occluded = arrays.get("occluded", np.zeros(len(time_s), dtype=bool))
    if joints.shape != (len(time_s), len(names), 3) or occluded.shape != time_s.shape or time_s.ndim != 1:
        raise InputError(path, f"its arrays do not fit together (joints {joints.shape}, time {time_s.shape})", remedy)
    if joints.dtype.kind not in "fiu" or time_s.dtype.kind not in "fiu":
        raise InputError(path, "its joints or times are not numbers", remedy)
    if len(time_s) == 0 or not (np.diff(time_s) > 0).all():
        raise InputError(path, "its times are none or do not increase", remedy)
    return Truth(time_s.astype(np.float64), _in_order(path, joints, names), occluded.astype(bool))


def _in_order(path: Path, joints: np.ndarray, names: list[str]) -> np.ndarray:
    position_m = np.full((len(joints), JOINT_COUNT, 3), np.nan)
    for column, name in enumerate(names):
        if name not in JOINT_INDEX or names.count(name) > 1:
            raise InputError(path, f"its joint '{name}' is unknown or given twice", f"use {', '.join(JOINT_NAMES)}")
        position_m[:, JOINT_INDEX[name]] = joints[:, column]
    return position_m


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
    everything = np.ones(joints.state_code.shape, dtype=bool)
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
            (str(state), _summary(joints, truth, joints.state_code == STATE_CODE[state])) for state in JointState
        ),
        hidden=_summary(joints, truth, np.isin(joints.state_code, [STATE_CODE[state] for state in HIDDEN])),
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
        joints.state_code[index],
        joints.sigma_m[index],
    )


def _truth_frames(truth: Truth, matched: np.ndarray) -> Truth:
    return Truth(truth.time_s[matched], truth.position_m[matched], truth.occluded[matched])
