"""Recognise clinical tests in the recording: five times sit to stand, functional reach, one-leg stance.

The recording does not state which test the patient was asked to do. So each test is recognised by its movements; a test
that is not recognised has no value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_INDEX
from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.frame_time import longest_dropped_s, runs_of_known, unbroken_runs, usual_step_s
from anchorpose.results.records import SIT_TO_STAND, Measure
from anchorpose.results.stand_training.stance import ANKLES, OTHER_SIDE, SIDES, Session, facing, known, unknown
from anchorpose.results.stand_training.upright import Transition, TransitionConfig, transitions
from anchorpose.results.uncertainty import JOINT_SHARE, NORMAL_95, systematic_sigma
from anchorpose.rotations import unit

TIMES: Final = 5  # number of rises in the test
LONGEST_SEATED_S: Final = 2.0
LONGEST_STOOD_S: Final = 5.0
"""Maximum time in s for which the patient sits (``LONGEST_SEATED_S``) or stands between two changes of posture in the
test. After a longer rest on the seat, the movement is not this test; standing may last longer, until the patient is
steady.
"""

TOUCH_S: Final = 0.1
"""Minimum duration of sitting and standing in s; in the test, people only touch the seat and rise again."""


def five_times_sit_to_stand(session: Session, config: TransitionConfig) -> Measure:
    """Measure the seconds from leaving the seat for the first time to standing for the fifth time."""
    name = "five_times_sit_to_stand"
    quick = replace(config, rest_s=TOUCH_S)
    moves = transitions(session.joints, session.stance, session.posture.upright, quick)
    series = _longest_series(moves, session.joints.time_s)
    rises = [move for move in series if move.kind == SIT_TO_STAND][:TIMES]
    if len(rises) < TIMES:
        why = (
            f"{TIMES} rises with no more than {LONGEST_SEATED_S:g} s of sitting and {LONGEST_STOOD_S:g} s of standing "
            f"between them were not seen ({len(rises)} were)"
        )
        return unknown(name, "s", why)
    first, last = rises[0], rises[-1]
    rows = slice(first.frames.start, last.frames.stop)
    time_s, state_code = session.joints.time_s[rows], session.stance.state_code[rows]
    # sigma_s of a rise contains the errors of its beginning and of its end; here, only the beginning of the first rise
    # and the end of the last rise count
    sigma = float(np.hypot(first.sigma_s, last.sigma_s) / np.sqrt(2.0))
    return known(name, "s", float(time_s[-1] - time_s[0]), state_code, sigma)


def _longest_series(moves: Sequence[Transition], time_s: np.ndarray) -> list[Transition]:
    """Return the longest series in which rising and sitting down alternate without long pauses, beginning with a rise.
    Of equally long series, return the first.
    """
    best, current = list[Transition](), list[Transition]()
    for before, move in pairwise([None, *moves]):
        assert move is not None
        pause_s = np.inf if before is None else time_s[move.frames.start] - time_s[before.frames.stop - 1]
        longest_s = LONGEST_SEATED_S if move.kind == SIT_TO_STAND else LONGEST_STOOD_S
        goes_on = before is not None and current and move.kind != before.kind and pause_s <= longest_s
        current = [*current, move] if goes_on else [move] if move.kind == SIT_TO_STAND else []
        best = current if len(current) > len(best) else best
    return best


LEVEL_DEG: Final = 10.0
STILL_LEVEL_DEG: Final = 35.0
"""Angles in degrees between arm and horizontal. An arm counts as raised once the angle is below ``LEVEL_DEG``, until it
exceeds ``STILL_LEVEL_DEG``.
"""

STRAIGHT: Final = 0.92
"""Minimum distance from shoulder to wrist, as a share of the arm's length; above this share, the elbow is bent by less
than 45 degrees.
"""

FORWARD: Final = 0.85
"""Minimum forward component of the raised arm, as a share of the arm's length; above this share, the arm points at most
32 degrees to a side.
"""

BASE_M: Final = 0.05  # m, maximum movement of an ankle while the foot counts as in its place
START_S: Final = 0.5  # s, first part of a reach; the reach is measured from the wrist's median place in this time
LEAST_REACH_S: Final = 1.0  # s, minimum duration of a reach


def functional_reach(session: Session, side: str) -> Measure:
    """Measure how far (mm) the wrist of the raised arm moves forward while the patient is upright with the feet in
    place.
    """
    measure = "functional_reach"
    position, sigma, time_s = session.joints.position_m, session.joints.sigma_m, session.joints.time_s
    forward = facing(position)
    raised, begins = _raised_arm(position, forward, side, session.upright)
    wrist = JOINT_INDEX[f"Wrist{side.capitalize()}"]
    best: tuple[float, float, slice] | None = None
    for run in unbroken_runs(raised, time_s, longest_dropped_s(time_s)):
        rows = np.arange(run.start, run.stop)
        rows = rows[np.argmax(begins[run]) :] if begins[run].any() else rows[:0]
        rows = rows[: _feet_stay(position, rows)]
        if len(rows) < 2 or time_s[rows[-1]] - time_s[rows[0]] < LEAST_REACH_S:
            continue
        ahead = np.median(forward[rows], axis=0)
        gone = (position[rows, wrist][:, [0, 2]] @ ahead) / np.linalg.norm(ahead)
        start = time_s[rows] <= time_s[rows[0]] + START_S
        reach, farthest = float(gone.max() - np.median(gone[start])), int(np.argmax(gone))
        if best is None or reach > best[0]:
            spread = float(np.hypot(sigma[rows[0], wrist], sigma[rows[farthest], wrist]))
            best = reach, spread, slice(int(rows[0]), int(rows[-1]) + 1)
    if best is None or best[0] <= NORMAL_95 * best[1]:
        why = "no arm was raised forward, straight, while upright with the feet in place" if best is None else _SHORT
        return unknown(measure, "mm", why, side)
    state_code = session.joints.state_code[best[2], wrist]
    return known(measure, "mm", 1000.0 * best[0], state_code, 1000.0 * best[1], side)


_SHORT: Final = "the raised arm went forward by no more than the errors of the wrist"


def _raised_arm(
    position_m: np.ndarray, forward: np.ndarray, side: str, upright: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return two arrays (n,) bool: whether the arm is straight, points forward and is within ``STILL_LEVEL_DEG`` of
    horizontal; and whether it also meets the narrower limits at which the test begins (``LEVEL_DEG``, ``FORWARD``).
    """
    shoulder, elbow, wrist = (position_m[:, JOINT_INDEX[f"{n}{side.capitalize()}"]] for n in _ARM)
    arm = wrist - shoulder
    length = np.linalg.norm(elbow - shoulder, axis=1) + np.linalg.norm(wrist - elbow, axis=1)
    reach = np.linalg.norm(arm, axis=1)
    along = unit(arm)
    ahead = (along[:, [0, 2]] * forward).sum(axis=1)
    level = np.abs(np.degrees(np.arcsin(np.clip(along[:, 1], -1.0, 1.0))))
    straight = upright & (reach >= STRAIGHT * length)
    raised = straight & (level <= STILL_LEVEL_DEG) & (ahead >= FORWARD * np.cos(np.radians(STILL_LEVEL_DEG)))
    return raised, raised & (level <= LEVEL_DEG) & (ahead >= FORWARD)


_ARM: Final = ("Shoulder", "Elbow", "Wrist")


def _feet_stay(position_m: np.ndarray, rows: np.ndarray) -> int:
    """Return the number of rows, from the first, in which both ankles stay within ``BASE_M`` of their places in the
    first row; 0 if an ankle is unknown in the first row.
    """
    if not len(rows):
        return 0
    ankles = position_m[rows][:, ANKLES]
    away = np.linalg.norm(ankles - ankles[0], axis=2).max(axis=1)
    left = np.flatnonzero(~(away <= BASE_M))
    return int(left[0]) if len(left) else len(rows)


LIFTED_M: Final = 0.06
LOWERED_M: Final = 0.04
"""Limits in m of the height of one ankle above the other. The higher foot counts as off the floor while this height
exceeds ``LOWERED_M``, if the height exceeds ``LIFTED_M`` at any time in this period.
"""

LEAST_STANCE_S: Final = 1.0
"""Minimum duration in s of a stance on one leg; a shorter stance is part of a step."""


def single_leg_stance(session: Session, side: str) -> Measure:
    """Measure the longest time in seconds on the leg of this side, the other foot off the floor, while the patient is
    upright and stays in place.
    """
    measure, time_s = "single_leg_stance", session.joints.time_s
    stands, lifted = (JOINT_INDEX[f"Ankle{name.capitalize()}"] for name in (side, OTHER_SIDE[side]))
    height = session.joints.position_m[:, lifted, 1] - session.joints.position_m[:, stands, 1]
    error = systematic_sigma(
        np.hypot(session.joints.sigma_m[:, lifted], session.joints.sigma_m[:, stands]), JOINT_SHARE
    )
    runs = [
        _longest_on_one_leg(session, height + shift * error, stands) for shift in (0.0, -1.0, 1.0)
    ]  # heights as measured, then heights lowered, then raised by their systematic sigma
    run, seconds = runs[0]
    if run is None or seconds < LEAST_STANCE_S:
        why = f"the other foot was never seen off the floor for {LEAST_STANCE_S:g} s while upright on a foot in place"
        return unknown(measure, "s", why, side)
    sigma = float(np.hypot(0.5 * (runs[2][1] - runs[1][1]), usual_step_s(time_s) / np.sqrt(6.0)))
    return known(measure, "s", seconds, session.joints.state_code[run][:, [stands, lifted]].max(axis=1), sigma, side)


def _longest_on_one_leg(session: Session, height_m: np.ndarray, stands: int) -> tuple[slice | None, float]:
    """Return the longest run of frames with one ankle lifted and the other (joint ``stands``) in place, and its
    seconds. A joint that is lost for a moment does not end the run. height_m (n,): height of the lifted ankle above the
    other.
    """
    time_s = session.joints.time_s
    best: tuple[slice | None, float] = (None, 0.0)
    is_known = (session.posture.upright != UNKNOWN) & np.isfinite(height_m)
    for run in runs_of_known(session.upright & (height_m > LOWERED_M), is_known, time_s):
        place = session.joints.position_m[run, stands]
        still = np.nanmax(np.linalg.norm(place - np.nanmedian(place, axis=0), axis=1)) <= 2.0 * BASE_M
        seconds = float(time_s[run.stop - 1] - time_s[run.start])
        if (height_m[run] >= LIFTED_M).any() and still and seconds > best[1]:
            best = (run, seconds)
    return best


def task_measures(session: Session, config: TransitionConfig) -> list[Measure]:
    """Return the measures of the three tests; functional reach and one-leg stance have one measure per side."""
    return [
        five_times_sit_to_stand(session, config),
        *(functional_reach(session, side) for side in SIDES),
        *(single_leg_stance(session, side) for side in SIDES),
    ]
