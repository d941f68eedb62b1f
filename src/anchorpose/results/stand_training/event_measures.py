"""Compute measures of events: number of events, number in ten minutes, time of the first event, and depth of the
deepest event; and the share of time in which an event would not have been seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from anchorpose.results.records import BUCKLE_LEFT, BUCKLE_RIGHT, FAILED_STAND, RECOVERY_LEFT, RECOVERY_RIGHT, Measure
from anchorpose.results.stand_training.buckles import buckle_watched
from anchorpose.results.stand_training.event import (
    NO_ONSET,
    ONSET_SIGMA_S,
    TOO_SLOW,
    Event,
    EventConfig,
    fast_enough,
    latency_sigma_s,
)
from anchorpose.results.stand_training.recovery_steps import recovery_watched
from anchorpose.results.stand_training.stance import Session, known, unknown
from anchorpose.results.stand_training.touch import NO_UPRIGHT

TEN_MINUTES_S: Final = 600.0
PER_TEN_MINUTES: Final = "per 10 min"

NONE_SEEN: Final = "no such event was seen"


class Watch(NamedTuple):
    """The frames in which events of one kind are searched for. measure: prefix of the names of the measures of these
    events. base (n,) bool: frames in which events of this kind can happen. watched (n,) bool: frames of ``base`` in
    which an event would have been detected. nothing: the reason, if ``base`` is empty, why the measures have no value.
    """

    measure: str
    side: str | None
    kind: str
    unit: str
    base: np.ndarray
    watched: np.ndarray
    nothing: str


def event_measures(session: Session, events: Sequence[Event], config: EventConfig) -> list[Measure]:
    """Return count, rate, latency, greatest depth, and unseen share of the time, for each kind of events and side."""
    return [row for watch in _watches(session, config) for row in _of_kind(session, events, watch)]


def _watches(session: Session, config: EventConfig) -> list[Watch]:
    buckles = [
        Watch("knee_buckle", s, kind, "deg", session.maybe_upright, buckle_watched(session, s, config), NO_UPRIGHT)
        for s, kind in (("left", BUCKLE_LEFT), ("right", BUCKLE_RIGHT))
    ]
    every, posture = np.ones(len(session.seconds), dtype=bool), session.stance.height + session.stance.thigh_deg
    balance = recovery_watched(session, config)
    recoveries = [
        Watch("recovery_step", s, kind, "mm", session.maybe_upright, balance, NO_UPRIGHT)
        for s, kind in (("left", RECOVERY_LEFT), ("right", RECOVERY_RIGHT))
    ]
    return [*buckles, Watch("failed_stand", None, FAILED_STAND, "1", every, np.isfinite(posture), ""), *recoveries]


def _of_kind(session: Session, events: Sequence[Event], watch: Watch) -> list[Measure]:
    seconds, side, name = session.seconds, watch.side, watch.measure
    own = [event for event in events if event.kind == watch.kind]
    base_s, watched_s = float(seconds[watch.base].sum()), float(seconds[watch.base & watch.watched].sum())
    units = {"count": "count", "rate": PER_TEN_MINUTES, "latency": "s", "largest": watch.unit, "unseen_share": "1"}
    why = None if fast_enough(session.joints.time_s) else TOO_SLOW
    why = why or (None if base_s else watch.nothing)
    if why is not None:
        return [unknown(f"{name}_{what}", unit, why, side) for what, unit in units.items()]
    codes = session.stance.state_code[watch.base & watch.watched]
    share = known(f"{name}_unseen_share", "1", max(1.0 - watched_s / base_s, 0.0), codes, side=side)
    if not watched_s and not own:
        why = "in no frame could an event have been distinguished from errors"
        return [*(unknown(f"{name}_{what}", unit, why, side) for what, unit in list(units.items())[:-1]), share]
    rate = unknown(f"{name}_rate", PER_TEN_MINUTES, "no time was known well enough to count in", side)
    if watched_s:
        rate = known(f"{name}_rate", PER_TEN_MINUTES, TEN_MINUTES_S * len(own) / watched_s, codes, side=side)
    return [
        known(f"{name}_count", "count", float(len(own)), codes, side=side),
        rate,
        *_first_and_greatest(session, own, watch),
        share,
    ]


def _first_and_greatest(session: Session, own: Sequence[Event], watch: Watch) -> list[Measure]:
    """Return the time from the start of the recording or trial to the first onset, and the greatest depth."""
    latency, largest = f"{watch.measure}_latency", f"{watch.measure}_largest"
    if not own:
        names = ((latency, "s"), (largest, watch.unit))
        return [unknown(name, unit, NONE_SEEN, watch.side) for name, unit in names]
    first, deepest = min(own, key=lambda event: event.frames.start), max(own, key=lambda event: event.depth)
    time_s = session.joints.time_s
    value, codes = float(time_s[first.frames.start] - session.onset_s), np.array([first.state_code])
    sigma_s = latency_sigma_s(time_s, ONSET_SIGMA_S)
    return [
        known(latency, "s", value, codes, sigma_s, watch.side)
        if session.onset_seen
        else unknown(latency, "s", NO_ONSET, watch.side, codes),
        known(largest, watch.unit, deepest.depth, np.array([deepest.state_code]), deepest.sigma, watch.side),
    ]
