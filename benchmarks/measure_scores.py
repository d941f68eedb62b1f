"""Compare clinical measures, angles and centre of mass of the tracked joints with those of the true joints.

The same formulas are used for both, so the scores judge the errors of tracking and the stated sigma; the formulas
themselves are judged by the tests. in_band: the difference is within 1.96 sigma; a count, which has no sigma, must be
equal. one_refuses: only one of both, the tracked or the true joints, gives a value.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from recordings import Ready
from suite import Scores

from anchorpose.recording.recording import half_period_s, nearest_within
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.measuring import MeasureConfig, measure_session
from anchorpose.results.records import STEP_LEFT, STEP_RIGHT, Episode, Measure
from anchorpose.results.stand_training.centre_of_mass import centre_of_mass
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.results.truth import read_truth
from anchorpose.results.uncertainty import NORMAL_95

CLINICAL: Final = (
    "_range",
    "five_times_sit_to_stand",
    "functional_reach",
    "single_leg_stance",
    "step_count",
    "swing_time_mean",
    "step_time_mean",
    "step_length_mean",
)
"""Endings of the names of measures that get rows of their own."""

SHARES: Final = ("in_band", "one_refuses")

SKIP_S: Final = 1.0  # s at the start that are not scored: tracking may settle
LEAST_FRAMES: Final = 6  # minimum number of frames in which an angle is known, for its error to count


def measures_against_truth(ready: Ready, results: Path) -> Iterator[tuple[str, Scores]]:
    """Yield the scores of each measure, of swings, of each angle (each side separately), and of the centre of mass."""
    assert ready.truth is not None
    found, true = joint_pair(results, ready.truth)
    (ours, rows), (theirs, exact) = (
        measure_session(joints, joint_angles(joints), None, MeasureConfig()) for joints in (found, true)
    )
    for row, known in zip(rows, exact, strict=True):
        scores = compare(row, known)
        if row.measure.endswith(CLINICAL):
            yield f"{row.measure}, {row.unit}", scores
        elif row.sigma and row.frames == known.frames:  # if a lost joint ends a bout, the values are not comparable
            yield "other measures", {name: value for name, value in scores.items() if name in SHARES}
    yield "swings", compare_swings(ours.episodes, theirs.episodes)
    yield from _angle_scores(found, true)
    yield "centre of mass", _mass_scores(found, true)


def joint_pair(results: Path, truth: Path) -> tuple[JointTable, JointTable]:
    """Return the tracked joints, and the true ones at the same times with next to no uncertainty."""
    joints, known = read_joints(results / JOINTS_FILE), read_truth(truth)
    row = nearest_within(known.time_s, joints.time_s, half_period_s(known.time_s))
    kept = (row >= 0) & (known.time_s >= known.time_s[0] + SKIP_S)
    found = JointTable(*(getattr(joints, name)[row[kept]] for name in JointTable.__slots__))
    exact = np.zeros_like(found.state_code), np.full_like(found.sigma_m, 1e-6)
    return found, JointTable(found.frame, found.time_s, known.position_m[kept], *exact)


def compare(found: Measure, true: Measure) -> Scores:
    """Score one measure; return no scores if neither ``found`` nor ``true`` has a value."""
    if found.value is None and true.value is None:
        return {}
    if found.value is None or true.value is None:
        return {"one_refuses": 1.0}
    off, sigma = abs(found.value - true.value), found.sigma or 0.0
    return {"one_refuses": 0.0, "in_band": float(off <= NORMAL_95 * sigma + 1e-9), "error": off, "sigma": sigma}


def compare_swings(found: Sequence[Episode], true: Sequence[Episode]) -> Scores:
    """Pair each true swing with the first unpaired tracked swing of the same foot that overlaps it; score the pairs."""
    late_s, left, missed = [], [one for one in found if one.kind in (STEP_LEFT, STEP_RIGHT)], 0
    for swing in (one for one in true if one.kind in (STEP_LEFT, STEP_RIGHT)):
        same = [
            one for one in left if one.kind == swing.kind and one.start_s < swing.end_s and swing.start_s < one.end_s
        ]
        if same:
            left.remove(same[0])
            late_s.append((same[0].start_s - swing.start_s, same[0].end_s - swing.end_s))
        else:
            missed += 1
    off_s, strike_s = np.mean(late_s, axis=0).tolist() if late_s else (float("nan"), float("nan"))
    counts = {"swings": float(len(late_s)), "missed": float(missed), "extra": float(len(left))}
    return counts | {"foot_off_late_s": off_s, "foot_strike_late_s": strike_s}


def _angle_scores(found: JointTable, true: JointTable) -> Iterator[tuple[str, Scores]]:
    """Yield each angle's mean error, and the share of its squared error that is constant over the recording."""
    ours, theirs = joint_angles(found), joint_angles(true)
    away = ours.degrees - theirs.degrees
    away -= 360.0 * np.round(away / 360.0)
    for column, name in enumerate(ours.names):
        known = np.isfinite(away[:, column])
        error, sigma = away[known, column], ours.sigma_deg[known, column]
        if len(error) >= LEAST_FRAMES:
            in_band = float((np.abs(error) <= NORMAL_95 * sigma).mean())
            lasting = float(error.mean() ** 2 / np.mean(error**2))
            scores = {"in_band": in_band, "error": float(np.abs(error).mean()), "lasting_share": lasting}
            yield f"angle {name.removesuffix('_left').removesuffix('_right')}, degrees", scores


def _mass_scores(found: JointTable, true: JointTable) -> Scores:
    """Score the centre of mass: length of the mean error in mm, and share of axes on which the error is in band."""
    ours = centre_of_mass(found)
    error_mm = 1e3 * (ours.position_m - centre_of_mass(true).position_m)
    known = np.isfinite(error_mm).all(axis=1)
    if not known.any():
        return {}
    sigma_mm = 1e3 * ours.sigma_m[known]
    in_band = float((np.abs(error_mm[known]) <= NORMAL_95 * sigma_mm[:, None]).mean())
    return {"in_band": in_band, "error": float(np.linalg.norm(error_mm[known].mean(axis=0))), "sigma": sigma_mm.mean()}
