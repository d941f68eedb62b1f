"""Standing up and sitting down."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.frame_time import frame_seconds, runs_of_known, unbroken_runs, usual_step_s
from anchorpose.results.records import SIT_TO_STAND, STAND_TO_SIT, Episode, Measure
from anchorpose.results.stand_training.session import Session, inferred_share
from anchorpose.results.stand_training.stance import Stance, hold
from anchorpose.results.stand_training.time_upright import NEVER_KNOWN, episode
from anchorpose.results.tables import UPRIGHT, JointTable
from anchorpose.results.uncertainty import random_sigma


@dataclass(frozen=True, slots=True, kw_only=True)
class TransitionConfig:
    """Seated: thighs near the level and the pelvis at rest for a while, so that a squat in passing is no sitting.

    Standing, too, must last: who comes near to it and sinks back has not stood up.
    """

    seated_enter_deg: float = 65.0
    seated_leave_deg: float = 55.0
    rest_s: float = 1.0  # the pelvis within ``rest_height`` of the seat, or of its height in standing
    rest_height: float = 0.05  # of the leg's length
    settle_s: float = 3.0  # of sitting and of standing next to the transition, in which the ends of the rise are found
    edge: float = 0.05  # of the rise: it begins when the pelvis has left the lower end by this much
    longest_s: float = 20.0  # between sitting and standing; slower ones are a stay between the two

    def __post_init__(self) -> None:
        if not 0 < self.seated_leave_deg <= self.seated_enter_deg < 90:
            raise ValueError("seated_leave_deg must lie between 0 and seated_enter_deg")
        if not 0 < self.edge < 0.5:
            raise ValueError("edge must lie between 0 and 0.5")
        if min(self.rest_s, self.rest_height, self.settle_s, self.longest_s) <= 0:
            raise ValueError("the times and rest_height must be positive")


@dataclass(frozen=True, slots=True)
class Transition:
    """frames: from the last that has not left its posture to the first that has reached the other."""

    kind: str
    frames: slice
    seconds: float
    sigma_s: float


def transitions(joints: JointTable, stance: Stance, state: np.ndarray, config: TransitionConfig) -> list[Transition]:
    """Every change between sitting and standing in whose course no joint was lost; state (n,) of ``upright``."""
    time_s, seconds, thigh = joints.time_s, frame_seconds(joints.time_s), stance.thigh_deg
    seated = hold(thigh >= config.seated_enter_deg, thigh < config.seated_leave_deg, np.isfinite(thigh)) == UPRIGHT
    sitting = [
        run
        for run in runs_of_known(seated, np.isfinite(thigh), time_s)
        if _rests(seconds[run], stance.height[run], config)
    ]
    standing = [
        run
        for run in runs_of_known(state == UPRIGHT, state != UNKNOWN, time_s)
        if _rests(seconds[run], -stance.height[run], config)
    ]
    postures = sorted([(run.start, run, False) for run in sitting] + [(run.start, run, True) for run in standing])
    known = unbroken_runs(np.isfinite(stance.height + thigh), time_s)
    found = list[Transition]()
    for (_, before, stood), (_, after, stands) in pairwise(postures):
        whole = any(stretch.start < before.stop and after.start < stretch.stop for stretch in known)
        if stood != stands and whole and time_s[after.start] - time_s[before.stop - 1] <= config.longest_s:
            found.append(_transition(time_s, stance, before, after, config, rises=stands))
    return found


def transition_episodes(joints: JointTable, stance: Stance, found: list[Transition]) -> tuple[Episode, ...]:
    """As rows of episodes.parquet."""
    return tuple(episode(one.kind, joints, stance.state_code, one.frames) for one in found)


def transition_measures(session: Session, found: list[Transition]) -> list[Measure]:
    """Of either kind how many there were, and the mean, shortest and longest duration; null of no known posture."""
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
        return Measure(measure=measure, value=None, unit="s", frames=0, why=NONE_SEEN)
    chosen = {
        "mean": ones,
        "shortest": [min(ones, key=lambda one: one.seconds)],
        "longest": [max(ones, key=lambda one: one.seconds)],
    }[which]
    state_code = np.concatenate([session.stance.state_code[one.frames] for one in chosen])
    return Measure(
        measure=measure,
        value=float(np.mean([one.seconds for one in chosen])),
        unit="s",
        sigma=float(np.sqrt(np.sum([one.sigma_s**2 for one in chosen])) / len(chosen)),
        frames=len(state_code),
        inferred_share=inferred_share(state_code),
    )


NONE_SEEN: Final = "none was seen from beginning to end"


LOW_PERCENTILE: Final = 10.0
"""The seat's height is the lowest of sitting, that of standing the highest, but for a tenth of the frames: medians
would take in the way up, the extreme frame its noise."""


def _rests(seconds: np.ndarray, height: np.ndarray, config: TransitionConfig) -> bool:
    """Whether the pelvis stays near the lowest of a run for long enough; height (k,), of standing turned over."""
    known = np.isfinite(height)
    if not known.any():
        return False
    still = known & (height <= np.percentile(height[known], LOW_PERCENTILE) + config.rest_height)
    return float(seconds[still].sum()) >= config.rest_s


def _transition(
    time_s: np.ndarray, stance: Stance, before: slice, after: slice, config: TransitionConfig, *, rises: bool
) -> Transition:
    """The part of the way between two postures in which the pelvis moves."""
    low, high = LOW_PERCENTILE, 100.0 - LOW_PERCENTILE
    first_percentile, last_percentile = (low, high) if rises else (high, low)
    start_level = _level(time_s, stance.height, before, config.settle_s, first_percentile, last=True)
    end_level = _level(time_s, stance.height, after, config.settle_s, last_percentile, last=False)
    way = (stance.height[before.start : after.stop] - start_level) / (end_level - start_level)
    middle = before.stop - before.start
    noise = float(np.nanmean(random_sigma(stance.height_sigma[before.stop - 1 : after.start + 1])))
    noise /= abs(end_level - start_level)  # a share of the way, as the edges are
    shake = min(noise, 0.5 * config.edge)  # edges that are tried must stay between the levels
    lengths = list[float]()
    for edge in (config.edge, config.edge + shake, config.edge - shake):
        first, last = _moving(way, middle, edge)
        lengths.append(float(time_s[before.start + last] - time_s[before.start + first]))
    first, last = _moving(way, middle, config.edge)
    step = usual_step_s(time_s[before.start : after.stop])
    off_s = 0.5 * abs(lengths[1] - lengths[2]) * noise / shake if shake else 0.0  # more noise than was tried: in line
    sigma_s = np.hypot(off_s, step / np.sqrt(6.0))  # both ends fall between two frames
    return Transition(
        SIT_TO_STAND if rises else STAND_TO_SIT,
        slice(before.start + first, before.start + last + 1),
        lengths[0],
        float(sigma_s),
    )


def _level(
    time_s: np.ndarray, height: np.ndarray, run: slice, settle_s: float, percentile: float, *, last: bool
) -> float:
    """Height of a posture, from the part of it that is next to the transition."""
    times = time_s[run]
    near = times >= times[-1] - settle_s if last else times <= times[0] + settle_s
    return float(np.nanpercentile(height[run][near], percentile))  # an ankle may have been lost while seated


def _moving(way: np.ndarray, middle: int, edge: float) -> tuple[int, int]:
    """First and last index of the move, way (k,) going from 0 to 1 and ``middle`` lying within it."""
    still, there = np.flatnonzero(way[: middle + 1] <= edge), np.flatnonzero(way[middle:] >= 1.0 - edge)
    first = int(still[-1]) if len(still) else 0
    last = middle + int(there[0]) if len(there) else len(way) - 1
    return first, last
