"""Find steps by the times at which a foot leaves the floor and comes down again, and compute measures of steps.

A foot swings while its ankle moves over the floor and the other ankle rests. Joints do not show forces, so foot off and
foot strike are taken to be the moments at which the ankle's movement begins and ends. The times of both have an error
of some hundredths of a second.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from anchorpose.joints import JOINT_INDEX, LOST
from anchorpose.results.frame_time import longest_dropped_s, unbroken_runs, usual_step_s
from anchorpose.results.records import STEP_LEFT, STEP_RIGHT, Episode, Measure
from anchorpose.results.stand_training.stance import ANKLES, Session, known, unknown
from anchorpose.results.stand_training.upright import episode
from anchorpose.results.tables import JointTable

SMOOTHING_S: Final = 0.06
"""Standard deviation in s of the kernel that smooths the ankles' paths; it is short compared to a swing, which lasts
0.3 s or more.
"""

MOVES_M_PER_S: Final = 0.20
RESTS_M_PER_S: Final = 0.10
"""Limits of an ankle's speed in m/s. In a swing, the speed exceeds ``MOVES_M_PER_S``; at rest, it stays below
``RESTS_M_PER_S`` in spite of noise.
"""

SHORTEST_M: Final = 0.06
AWAY_M: Final = 0.02
"""Limits of an ankle's movement in m. In a step, the ankle moves by at least ``SHORTEST_M``. The swing lasts while the
ankle is farther than ``AWAY_M`` from its places of rest before and after the step.
"""

LONGEST_S: Final = 2.0  # s, maximum duration of a swing
EVENT_SIGMA_S: Final = 0.06
"""Standard deviation in s of the error in the time of foot off or foot strike, on simulated steps (docs/measures.md).
"""

LONGEST_PAUSE_S: Final = 2.0
"""Maximum time in s between successive steps; after a longer time, a new series of steps begins."""


@dataclass(frozen=True, slots=True)
class Step:
    """A step. frames: rows of the swing, from foot off to foot strike; length_m: distance between both ankles at foot
    strike, in the direction of the step; None for a step in place.
    """

    side: str
    frames: slice
    length_m: float | None


def find_steps(joints: JointTable, upright: np.ndarray) -> list[Step]:
    """Find all steps of an upright patient with both ankles known, in the order of time; upright (n,) bool."""
    step_s = usual_step_s(joints.time_s)
    if not np.isfinite(step_s):
        return []
    ankles = {side: joints.position_m[:, JOINT_INDEX[f"Ankle{side.capitalize()}"]] for side in ("left", "right")}
    known = upright & np.isfinite(ankles["left"] + ankles["right"]).all(axis=1)
    found = list[Step]()
    for run in unbroken_runs(known, joints.time_s, longest_dropped_s(joints.time_s)):
        if run.stop - run.start > 3:
            width = SMOOTHING_S / step_s
            paths = {side: gaussian_filter1d(at[run], width, axis=0, mode="nearest") for side, at in ankles.items()}
            found += _in_run(paths, joints.time_s[run], run.start)
    return sorted(found, key=lambda step: step.frames.start)


def _in_run(paths: dict[str, np.ndarray], time_s: np.ndarray, first: int) -> list[Step]:
    speed = {side: np.linalg.norm(np.gradient(path, time_s, axis=0), axis=1) for side, path in paths.items()}
    found = []
    for side, other in (("left", "right"), ("right", "left")):
        for run in _whole(unbroken_runs(speed[side] > RESTS_M_PER_S, time_s), paths[side][:, 1]):
            inside = run.start > 0 and run.stop < len(time_s)  # whether the run contains both foot off and foot strike
            fast = speed[side][run].max() >= MOVES_M_PER_S
            rests = np.median(speed[other][run]) < np.median(speed[side][run]) / 2.0
            swing = _swing(paths[side], _until_at_rest(speed[side], run)) if inside and fast and rests else None
            if swing is not None and time_s[swing.stop - 1] - time_s[swing.start] <= LONGEST_S:
                length_m = _length(paths[side], paths[other], swing)
                found.append(Step(side, slice(first + swing.start, first + swing.stop), length_m))
    return found


def _whole(runs: Iterable[slice], height_m: np.ndarray) -> list[slice]:
    """Join two runs of an ankle's movement to one swing if the foot is in the air in the pause between them: the ankle
    is then higher than at rest.
    """
    whole = list[slice]()
    for run in runs:
        if whole:
            before = whole[-1]
            rested_m = max(height_m[max(before.start - 1, 0)], height_m[min(run.stop, len(height_m) - 1)])
            if height_m[before.stop : run.start].min(initial=np.inf) > rested_m + AWAY_M:
                run = slice(whole.pop().start, run.stop)
        whole.append(run)
    return whole


def _length(path_m: np.ndarray, other_m: np.ndarray, swing: slice) -> float | None:
    """Return the distance between the ankles at foot strike, in the direction of the step; None for a step in place."""
    way = (path_m[swing.stop - 1] - path_m[swing.start])[[0, 2]]
    moved_m = float(np.linalg.norm(way))
    if moved_m < SHORTEST_M:
        return None
    return abs(float((path_m[swing.stop - 1] - other_m[swing.stop - 1])[[0, 2]] @ way)) / moved_m


def _until_at_rest(speed: np.ndarray, run: slice) -> slice:
    """Extend a run at both ends, as long as the speed falls, so that it includes the slow beginning and end of the
    movement.
    """
    start, stop = run.start, run.stop
    while start > 1 and speed[start - 1] < speed[start]:
        start -= 1
    while stop < len(speed) - 1 and speed[stop] < speed[stop - 1]:
        stop += 1
    return slice(start, stop)


def _swing(path_m: np.ndarray, run: slice) -> slice | None:
    """Return the frames in which the ankle, path_m (n, 3), is away from both of its places of rest; None if the
    movement is shorter than a step.
    """
    path = path_m[run.start - 1 : run.stop + 1]
    left, reached = (np.linalg.norm(path - place, axis=1) for place in (path[0], path[-1]))
    if left.max() < SHORTEST_M:
        return None
    before, behind = np.flatnonzero(left > AWAY_M), np.flatnonzero(reached > AWAY_M)
    if not len(behind):
        return None
    return slice(run.start - 1 + int(before[0]), run.start + int(behind[-1]) + 1)


def step_episodes(joints: JointTable, steps: list[Step]) -> tuple[Episode, ...]:
    """Return the swings of steps as rows of episodes.parquet: they begin at foot off and end at foot strike."""
    ankles = joints.state_code[:, ANKLES].max(axis=1)
    kinds = {"left": STEP_LEFT, "right": STEP_RIGHT}
    return tuple(episode(kinds[step.side], joints, step.frames, ankles[step.frames].max()) for step in steps)


def step_measures(session: Session, steps: list[Step]) -> list[Measure]:
    """Return count, swing time and step length per side, and the time from one foot's strike to the strike of the other
    foot.
    """
    rows = [measure for side in ("left", "right") for measure in _of_side(session, steps, side)]
    time_s = session.joints.time_s
    seen_on = _seen_until(session)
    between = [
        (float(time_s[later.frames.stop - 1] - time_s[before.frames.stop - 1]), later)
        for before, later in pairwise(steps)
        if later.side != before.side and seen_on[before.frames.stop - 1] >= time_s[later.frames.stop - 1]
    ]
    between = [each for each in between if each[0] <= LONGEST_PAUSE_S]
    sigma = np.sqrt(2.0) * EVENT_SIGMA_S
    return [*rows, _mean(session, "step_time_mean", None, "s", between, sigma, _NO_PAIR)]


def _seen_until(session: Session) -> np.ndarray:
    """Return, for each frame (n,), the time in s until which both ankles stay known without a gap in which a step could
    be missed; the frame's own time if an ankle is lost in it.
    """
    time_s = session.joints.time_s
    until_s = time_s.copy()
    both = np.asarray((session.joints.state_code[:, ANKLES] < LOST).all(axis=1))
    for run in unbroken_runs(both, time_s, longest_dropped_s(time_s)):
        until_s[run] = time_s[run.stop - 1]
    return until_s


_NO_STEP: Final = "no step of this foot was seen from foot off to foot strike while upright"
_NO_PAIR: Final = "no step was followed by a step of the other foot"
_NEVER: Final = "the ankles were never both known while upright"


def _of_side(session: Session, steps: list[Step], side: str) -> list[Measure]:
    own, time_s = [step for step in steps if step.side == side], session.joints.time_s
    seen = session.upright & (session.joints.state_code[:, ANKLES] < LOST).all(axis=1)
    frames, count = int(seen.sum()), unknown("step_count", "count", _NEVER, side)
    if frames:
        count = replace(count, value=float(len(own)), frames=frames, why=None)
    swings = [(float(time_s[step.frames.stop - 1] - time_s[step.frames.start]), step) for step in own]
    lengths = [(1000.0 * step.length_m, step) for step in own if step.length_m is not None]
    error = session.joints.sigma_m[seen][:, ANKLES]
    spread = 1000.0 * float(np.sqrt((error**2).sum(axis=1).mean())) if frames else 0.0
    return [
        count,
        _mean(session, "swing_time_mean", side, "s", swings, float(np.sqrt(2.0)) * EVENT_SIGMA_S, _NO_STEP),
        _mean(session, "step_length_mean", side, "mm", lengths, spread, _NO_STEP),
    ]


def _mean(
    session: Session, name: str, side: str | None, unit: str, found: list[tuple[float, Step]], sigma: float, why: str
) -> Measure:
    """Return the mean of the values in ``found`` as a measure. Half of the variance (sigma^2) of each value's error is
    assumed (not measured) to be common to all values.
    """
    if not found:
        return unknown(name, unit, why, side)
    state_code = np.concatenate([session.joints.state_code[step.frames][:, ANKLES].max(axis=1) for _, step in found])
    value, spread = float(np.mean([value for value, _ in found])), float(sigma * np.sqrt(0.5 + 0.5 / len(found)))
    return known(name, unit, value, state_code, spread, side)
