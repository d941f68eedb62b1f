"""Find knees that buckle: one knee bends fast, and farther than the other, while the patient stands on that leg.

The definition of a buckle is this project's own. A buckle differs from other flexion in three ways:

- a squat or sitting down bends both knees alike, so a buckling knee must bend farther than the other knee, by at least
  a fixed share of its own flexion;
- a step lifts the foot, so in a buckle the hip must sink more than the ankle rises, and the foot must stay in its
  place;
- a knee that is lowered slowly is controlled, so the flexion must be fast.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter

from anchorpose.joints import JOINT_INDEX
from anchorpose.results.frame_time import followed, longest_dropped_s, unbroken_runs, usual_step_s
from anchorpose.results.records import BUCKLE_LEFT, BUCKLE_RIGHT, STAND_TO_SIT
from anchorpose.results.stand_training.event import (
    BRIEF_SHARE,
    CHANGE_SHARE,
    Event,
    EventConfig,
    fast_enough,
    onset_row,
)
from anchorpose.results.stand_training.stance import OTHER_SIDE, Angle, Session
from anchorpose.results.stand_training.steps import SHORTEST_M
from anchorpose.results.uncertainty import sigma_of_difference

KINDS: Final = {"left": BUCKLE_LEFT, "right": BUCKLE_RIGHT}

HELD_S: Final = 0.1
"""Length in s of the window of the running median of the angles, which removes errors of single frames."""

SMOOTHING_S: Final = 0.03
"""Standard deviation in s of the kernel that smooths the angles, a tenth of the time in which a knee gives way."""

BEFORE_S: Final = 0.3
"""Time in s before the flexion. The median angle in this time is the angle from which the depth of the flexion is
measured.
"""

STILL_DEEPER_S: Final = 0.4
"""Time in s after the deepest angle. If the knee bends deeper within this time, the same flexion continues."""


LEAD_SHARE: Final = 0.33
"""Minimum difference between the flexions of a buckling knee and of the other knee, as a share of the buckling knee's
flexion. If the other knee flexes by more than two thirds as much, the movement is a squat.
"""


def find_buckles(session: Session, config: EventConfig) -> list[Event]:
    """Return the buckles of both knees in the order of time; an empty list if the frames are too far apart."""
    if not fast_enough(session.joints.time_s):
        return []
    found = [event for side in KINDS for event in _of_side(session, side, config)]
    return sorted(found, key=lambda event: event.frames.start)


def buckle_watched(session: Session, side: str, config: EventConfig) -> np.ndarray:
    """Return (n,) bool: frames in which a buckle of this knee that is ``buckle_deg`` deep could begin and be found. In
    such a frame, the patient is upright, the buckle could be distinguished from errors of measurement, and the angles
    of both knees are known in all frames of the next ``fast_s``. Dropped frames are allowed, one at a time.
    """
    own, other = (session.angle(f"knee_flexion_{each}") for each in (side, OTHER_SIDE[side]))
    error = config.times_sigma * CHANGE_SHARE * np.hypot(own.sigma_deg, other.sigma_deg)
    clear = session.upright & (error <= config.buckle_deg)
    return clear & followed(np.isfinite(own.degrees + other.degrees), session.joints.time_s, config.fast_s)


def _of_side(session: Session, side: str, config: EventConfig) -> Iterator[Event]:
    own, other = (session.angle(f"knee_flexion_{each}") for each in (side, OTHER_SIDE[side]))
    time_s, step_s = session.joints.time_s, usual_step_s(session.joints.time_s)
    for run in unbroken_runs(np.isfinite(own.degrees + other.degrees), time_s, longest_dropped_s(time_s)):
        knees = tuple(_calm(knee.degrees[run], step_s) for knee in (own, other))
        for flexion in _fast_flexions(time_s[run], knees[0], config):
            sigma = _sigma(own, flexion, run.start)
            lead = _rise(knees[0] - knees[1], flexion)
            lead_sigma = float(np.hypot(sigma, _sigma(other, flexion, run.start)))
            enough = flexion.depth_deg >= max(config.buckle_deg, config.times_sigma * sigma)
            frames = slice(run.start + flexion.onset, run.start + flexion.deepest + 1)
            leads = lead >= max(config.lead_deg, config.times_sigma * lead_sigma, LEAD_SHARE * flexion.depth_deg)
            if enough and leads and _gives_way(session, side, frames):
                state_code = int(own.state_code[frames].max())
                yield Event(KINDS[side], frames, flexion.depth_deg, sigma, "deg", state_code)


def _calm(degrees: np.ndarray, step_s: float) -> np.ndarray:
    window = 2 * round(0.5 * HELD_S / step_s) + 1
    without_errors = median_filter(degrees, window, mode="nearest")
    return gaussian_filter1d(without_errors, SMOOTHING_S / step_s, mode="nearest")


@dataclass(frozen=True, slots=True)
class Flexion:
    """A flexion of a knee. before: rows whose median is the angle before the flexion; onset, deepest: rows at which the
    flexion begins and is deepest; depth_deg: change of the angle from ``before`` to ``deepest``.
    """

    before: slice
    onset: int
    deepest: int
    depth_deg: float


def _fast_flexions(time_s: np.ndarray, degrees: np.ndarray, config: EventConfig) -> Iterator[Flexion]:
    """Yield the flexions that bend the knee by at least ``buckle_deg`` within ``fast_s``. time_s, degrees (k,): times
    and angles of a run of frames with known angles, in which at most one frame is dropped at a time.
    """
    frames = round(config.fast_s / usual_step_s(time_s)) + 1 if len(time_s) > 1 else 1
    padded = np.concatenate([np.full(frames - 1, degrees[0]), degrees])
    windows = np.lib.stride_tricks.sliding_window_view(padded, frames)
    fast, done = degrees - windows.min(axis=1) >= config.buckle_deg, -1
    for first in np.flatnonzero(fast).tolist():
        lowest = max(first - frames + 1 + int(windows[first].argmin()), 0)
        if lowest > done:
            done = _deepest(time_s, degrees, first)
            yield _measured(time_s, degrees, lowest, done)


def _deepest(time_s: np.ndarray, degrees: np.ndarray, first: int) -> int:
    best = first
    for row in range(first, len(degrees)):
        if degrees[row] > degrees[best]:
            best = row
        elif time_s[row] - time_s[best] > STILL_DEEPER_S:
            break
    return best


def _measured(time_s: np.ndarray, degrees: np.ndarray, lowest: int, deepest: int) -> Flexion:
    before = slice(int(np.searchsorted(time_s, time_s[lowest] - BEFORE_S)), lowest + 1)
    base = float(np.median(degrees[before]))
    onset = onset_row(time_s, degrees, base, slice(lowest, deepest + 1))
    return Flexion(before, onset, deepest, float(degrees[deepest]) - base)


def _rise(values: np.ndarray, flexion: Flexion) -> float:
    return float(values[flexion.onset : flexion.deepest + 1].max() - np.median(values[flexion.before]))


def _sigma(knee: Angle, flexion: Flexion, first: int) -> float:
    before, after = (float(knee.sigma_deg[first + row]) for row in (flexion.onset, flexion.deepest))
    return sigma_of_difference(before, after, BRIEF_SHARE)


def _gives_way(session: Session, side: str, frames: slice) -> bool:
    """Return whether a knee gives way in a flexion: the patient stood on this foot, the foot stays in place, the hip
    sinks more than the ankle rises, and the patient does not sit down.
    """
    first, last = frames.start, frames.stop - 1
    start_s, end_s = session.joints.time_s[[first, last]]
    sits = any(e.kind == STAND_TO_SIT and e.start_s <= end_s and e.end_s >= start_s for e in session.episodes)
    hip, ankle = (session.joints.position_m[:, JOINT_INDEX[f"{name}{side.capitalize()}"]] for name in ("Hip", "Ankle"))
    sinks_m, lifts_m = hip[first, 1] - hip[last, 1], ankle[last, 1] - ankle[first, 1]
    stays = np.linalg.norm((ankle[last] - ankle[first])[[0, 2]]) < SHORTEST_M
    return bool(session.standing[first] and not sits and stays and sinks_m > lifts_m)
