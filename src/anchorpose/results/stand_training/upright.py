"""Compute upright time and its bouts, and the changes between sitting and standing."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from anchorpose.joints import JointState
from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.frame_time import frame_seconds, recorded_seconds, runs_of_known, unbroken_runs, usual_step_s
from anchorpose.results.records import SIT_TO_STAND, STAND_TO_SIT, UPRIGHT_EPISODE, Episode, Measure
from anchorpose.results.stand_training.stance import Session, Stance, hold, known, unknown
from anchorpose.results.tables import UPRIGHT, JointTable
from anchorpose.results.uncertainty import JOINT_SHARE, random_sigma
from anchorpose.settings import Positive, settings

NO_TIME: Final = "the recording has a single frame, which has no duration"
NEVER_KNOWN: Final = "in no frame was it known whether the patient was upright"
NONE_SEEN: Final = "none was seen from beginning to end"

LOW_PERCENTILE: Final = 10.0
"""Percentile of the pelvis' heights while sitting that is used as the seated height. The standing height is the
percentile 100 minus this value of the heights while standing. A median would be affected by frames of the rise, an
extreme value by the noise of a single frame.
"""


def upright_episodes(joints: JointTable, stance: Stance, state: np.ndarray) -> tuple[Episode, ...]:
    """Return the upright bouts as episodes. state (n,): ``UPRIGHT``, ``NOT_UPRIGHT`` or ``UNKNOWN``."""
    return tuple(
        episode(UPRIGHT_EPISODE, joints, run, stance.state_code[run].max())
        for run in runs_of_known(state == UPRIGHT, state != UNKNOWN, joints.time_s)
    )


def episode(kind: str, joints: JointTable, run: slice, worst: int) -> Episode:
    """Return the frames of ``run`` as an episode; worst: worst state code of the joints by which the episode is
    recognised.
    """
    return Episode(
        kind=kind,
        first_frame=int(joints.frame[run.start]),
        last_frame=int(joints.frame[run.stop - 1]),
        start_s=float(joints.time_s[run.start]),
        end_s=float(joints.time_s[run.stop - 1]),
        state=tuple(JointState)[worst],
    )


UPRIGHT_MEASURES: Final = {
    "upright_time": "s",
    "upright_share": "1",
    "upright_bouts": "count",
    "longest_upright_bout": "s",
}


def time_measures(session: Session) -> list[Measure]:
    """Return seven measures: the recorded time; the time in which the patient was found; the time in which it is
    unknown whether the patient was upright; the upright time; its share of the time in which this is known; the number
    of upright bouts; and the longest of these bouts.
    """
    seconds, state, state_code = session.seconds, session.posture.upright, session.stance.state_code
    is_known, standing = state != UNKNOWN, state == UPRIGHT
    total, known_s = recorded_seconds(session.joints.time_s), float(seconds[is_known].sum())
    runs = runs_of_known(standing, is_known, session.joints.time_s)
    times = (
        ("recorded_time", total, len(seconds)),
        ("found_time", float(seconds[session.found].sum()), int(session.found.sum())),
        ("unknown_time", max(total - known_s, 0.0), len(seconds)),
    )
    codes = state_code[is_known]
    why = None if total else NO_TIME
    rows = [
        Measure(measure=name, unit="s", value=value if total else None, frames=frames, why=why)
        for name, value, frames in times
    ]
    if not known_s:
        why = NEVER_KNOWN if total else NO_TIME
        return rows + [unknown(name, unit, why, state_code=codes) for name, unit in UPRIGHT_MEASURES.items()]
    upright_s, sigma_s = float(seconds[standing].sum()), _sigma_s(session)
    longest_s = max((float(seconds[run][standing[run]].sum()) for run in runs), default=0.0)
    values = (upright_s, upright_s / known_s, float(len(runs)), longest_s)
    sigmas = (sigma_s, sigma_s / known_s, None, sigma_s)
    return rows + [
        known(name, unit, value, codes, sigma)
        for (name, unit), value, sigma in zip(UPRIGHT_MEASURES.items(), values, sigmas, strict=True)
    ]


def _sigma_s(session: Session) -> float:
    """Return sigma of the upright time, which combines two errors. For the first error, the upright time is computed
    twice: with all values shifted by one sigma towards standing, and with all values shifted by one sigma away from
    standing. The first error is half of the difference between these two times.

    The second error is that every beginning and end of a bout may be half a frame off.
    """
    state = session.posture.upright
    edges = 2 * len(runs_of_known(state == UPRIGHT, state != UNKNOWN, session.joints.time_s))
    usual = float(np.median(session.seconds))
    less, more = session.seconds @ (session.shifted_upright == UPRIGHT)
    return float(np.hypot(0.5 * (more - less), 0.5 * np.sqrt(edges) * usual))


@settings
class TransitionConfig:
    """Settings of transitions between sitting and standing. A patient sits if both thighs are nearly level, the pelvis
    rests for a while, and the centre of mass is behind the heels.

    A squat does not count as sitting: in a short squat, the pelvis does not rest, and people cannot squat with the
    centre of mass behind the heels. Standing must last, too: a patient who nearly stands and sinks back has not stood
    up.
    """

    # degrees from the vertical; sitting begins when both thighs are inclined by more than this
    seated_enter_deg: Positive = 65.0
    # degrees from the vertical; sitting ends when a thigh is inclined by less than this
    seated_leave_deg: Positive = 55.0
    behind_feet_m: Positive = 0.07  # m, least distance of a seated centre of mass behind the ankles: a heel plus errors
    rest_s: Positive = 1.0  # s, minimum time of the pelvis within ``rest_height`` of its seated or standing height
    rest_height: Positive = 0.05  # leg lengths, tolerance of the pelvis's height at rest
    settle_s: Positive = 3.0  # s, time before and after a transition in which the heights of both postures are measured
    # share of the height's change that is left out at the beginning, and again at the end, of a transition
    edge: Positive = 0.05
    longest_s: Positive = 20.0  # s, maximum duration of a transition; a longer transition includes a pause

    def __post_init__(self) -> None:
        if not self.seated_leave_deg <= self.seated_enter_deg < 90:
            raise ValueError("seated_enter_deg must lie between seated_leave_deg and 90")
        if not self.edge < 0.5:
            raise ValueError("edge must be less than 0.5")


@dataclass(frozen=True, slots=True)
class Transition:
    """A change between sitting and standing. frames: from the last frame in one posture to the first in the other;
    seconds: its duration, with the standard deviation sigma_s.
    """

    kind: str
    frames: slice
    seconds: float
    sigma_s: float


class Postures(NamedTuple):
    """Runs of frames in which the patient sits and stands, in the order of time, each long enough to count."""

    sitting: list[slice]
    standing: list[slice]


def settled_postures(joints: JointTable, stance: Stance, state: np.ndarray, config: TransitionConfig) -> Postures:
    """Return the runs of frames in which the patient sits, and the runs in which the patient stands; in each run, the
    pelvis is at rest for at least ``rest_s``. state (n,): ``UPRIGHT``, ``NOT_UPRIGHT`` or ``UNKNOWN``.
    """
    time_s, seconds, thigh = joints.time_s, frame_seconds(joints.time_s), stance.thigh_deg
    seated = hold(thigh >= config.seated_enter_deg, thigh < config.seated_leave_deg, np.isfinite(thigh)) == UPRIGHT
    sitting = [
        run
        for run in runs_of_known(seated, np.isfinite(thigh), time_s)
        if _rests(seconds[run], stance.height[run], config) and _needs_a_seat(stance.behind_m[run], config)
    ]
    standing = [
        run
        for run in runs_of_known(state == UPRIGHT, state != UNKNOWN, time_s)
        if _rests(seconds[run], -stance.height[run], config)
    ]
    return Postures(sitting, standing)


def posture_stretches(stance: Stance, time_s: np.ndarray) -> list[slice]:
    """Return the unbroken runs of frames in which the pelvis' height and the thighs' inclination are known."""
    return unbroken_runs(np.isfinite(stance.height + stance.thigh_deg), time_s)


def transitions(joints: JointTable, stance: Stance, state: np.ndarray, config: TransitionConfig) -> list[Transition]:
    """Return every change between sitting and standing in which no joint was lost. state (n,): ``UPRIGHT``,
    ``NOT_UPRIGHT`` or ``UNKNOWN``.
    """
    time_s, settled = joints.time_s, settled_postures(joints, stance, state, config)
    postures = sorted(
        [(run.start, run, False) for run in settled.sitting] + [(run.start, run, True) for run in settled.standing]
    )
    stretches = posture_stretches(stance, time_s)
    found = list[Transition]()
    for (_, before, stood), (_, after, stands) in pairwise(postures):
        whole = any(stretch.start < before.stop and after.start < stretch.stop for stretch in stretches)
        if stood != stands and whole and time_s[after.start] - time_s[before.stop - 1] <= config.longest_s:
            found.append(_transition(time_s, stance, before, after, config, rises=stands))
    return found


def transition_episodes(joints: JointTable, stance: Stance, found: list[Transition]) -> tuple[Episode, ...]:
    """Return transitions as rows of episodes.parquet."""
    return tuple(episode(one.kind, joints, one.frames, stance.state_code[one.frames].max()) for one in found)


def transition_measures(session: Session, found: list[Transition]) -> list[Measure]:
    """Compute, for each kind of transition, the count and the mean, shortest and longest duration; the measures have no
    values if posture is never known.
    """
    rows = list[Measure]()
    frames = int((session.posture.upright != UNKNOWN).sum())
    for kind in (SIT_TO_STAND, STAND_TO_SIT):
        ones = [one for one in found if one.kind == kind]
        count, why = (float(len(ones)), None) if frames else (None, NEVER_KNOWN)
        rows.append(Measure(measure=f"{kind}_count", value=count, unit="count", frames=frames, why=why))
        rows += [_duration(session, ones, kind, which) for which in ("mean", "shortest", "longest")]
    return rows


def _duration(session: Session, ones: list[Transition], kind: str, which: str) -> Measure:
    measure = f"{kind}_duration_{which}"
    if not ones:
        return unknown(measure, "s", NONE_SEEN)
    extreme = {"shortest": min, "longest": max}.get(which)
    chosen = [extreme(ones, key=lambda one: one.seconds)] if extreme else ones
    state_code = np.concatenate([session.stance.state_code[one.frames] for one in chosen])
    sigma_s = float(np.sqrt(np.sum([one.sigma_s**2 for one in chosen])) / len(chosen))
    return known(measure, "s", float(np.mean([one.seconds for one in chosen])), state_code, sigma_s)


def _rests(seconds: np.ndarray, height: np.ndarray, config: TransitionConfig) -> bool:
    """Return whether the pelvis stays near its lowest height in a run for long enough. height (k,): height of the
    pelvis. For standing, pass the height with the sign reversed, since the pelvis must then stay near its greatest
    height.
    """
    there = np.isfinite(height)
    if not there.any():
        return False
    still = there & (height <= np.percentile(height[there], LOW_PERCENTILE) + config.rest_height)
    return float(seconds[still].sum()) >= config.rest_s


def _needs_a_seat(behind_m: np.ndarray, config: TransitionConfig) -> bool:
    """Return whether, at some moment of a run, the centre of mass is too far behind the feet for them to carry the
    patient alone; True if unknown. behind_m (k,): distance in m of the centre of mass behind the midpoint of the
    ankles.
    """
    measured_m = behind_m[np.isfinite(behind_m)]
    return not len(measured_m) or bool(measured_m.max() > config.behind_feet_m)


def _transition(
    time_s: np.ndarray, stance: Stance, before: slice, after: slice, config: TransitionConfig, *, rises: bool
) -> Transition:
    """Return the transition between two postures: the frames in which the pelvis moves."""
    low, high = LOW_PERCENTILE, 100.0 - LOW_PERCENTILE
    first_percentile, last_percentile = (low, high) if rises else (high, low)
    start_level = _level(time_s, stance.height, before, config.settle_s, first_percentile, last=True)
    end_level = _level(time_s, stance.height, after, config.settle_s, last_percentile, last=False)
    way = (stance.height[before.start : after.stop] - start_level) / (end_level - start_level)
    middle = before.stop - before.start
    noise = float(np.nanmean(random_sigma(stance.height_sigma[before.stop - 1 : after.start + 1], JOINT_SHARE)))
    noise /= abs(end_level - start_level)  # ``noise`` is now a share of the height's change, like ``edge``
    shake = min(noise, 0.5 * config.edge)  # at most half of ``edge``, so that ``edge - shake`` is above 0
    moves = [_moving(way, middle, edge) for edge in (config.edge, config.edge + shake, config.edge - shake)]
    lengths = [float(time_s[before.start + last] - time_s[before.start + first]) for first, last in moves]
    first, last = moves[0]
    step = usual_step_s(time_s[before.start : after.stop])
    off_s = 0.5 * abs(lengths[1] - lengths[2]) * noise / shake if shake else 0.0  # effect of ``noise`` on duration
    sigma_s = np.hypot(off_s, step / np.sqrt(6.0))  # second term: error of sampling, since the ends lie between frames
    return Transition(
        SIT_TO_STAND if rises else STAND_TO_SIT,
        slice(before.start + first, before.start + last + 1),
        lengths[0],
        float(sigma_s),
    )


def _level(
    time_s: np.ndarray, height: np.ndarray, run: slice, settle_s: float, percentile: float, *, last: bool
) -> float:
    """Return the height of a posture in the ``settle_s`` seconds of its run next to the transition: the run's last
    seconds if ``last``, else its first seconds.
    """
    times = time_s[run]
    near = times >= times[-1] - settle_s if last else times <= times[0] + settle_s
    return float(np.nanpercentile(height[run][near], percentile))  # ignores NaN: an ankle may be lost while seated


def _moving(way: np.ndarray, middle: int, edge: float) -> tuple[int, int]:
    """Return the first and last index of the movement around the index ``middle``. way (k,): height from 0 (before) to
    1 (after); edge: share of this height that is left out at the beginning and at the end of the movement.
    """
    still, there = np.flatnonzero(way[: middle + 1] <= edge), np.flatnonzero(way[middle:] >= 1.0 - edge)
    first = int(still[-1]) if len(still) else 0
    last = middle + int(there[0]) if len(there) else len(way) - 1
    return first, last
