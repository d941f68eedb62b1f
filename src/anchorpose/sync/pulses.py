"""Find another device's clock from pulses that both devices recorded, by matching the pulses' starts and ends.

A signal does not state whether its pulses begin at rising or at falling edges, so both interpretations (readings) are
tried. The share of time at each level does not decide between them: a stimulator is at the level of a pulse for more
than half of the time, a trigger hardly ever.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from anchorpose.agreement.clock import RIVAL_DISTANCE_S, NoCommonMovement, OtherClock
from anchorpose.calibration.clock_lags import DRIFT_SIGMA
from anchorpose.recording.recording import nearest_within

MOST_PULSES: Final = 1000
"""Maximum number of pulses in a file. A signal with more pulses is not a pulse signal, or its pulses trigger a camera
at even intervals, so that many offsets match.
"""

LEAST_PULSES: Final = 3
"""Minimum number of matched pulses if the offset is unknown. Two would be too few: by chance, two pulses in one file
are often as far apart as two pulses in the other.
"""

ANCHORS: Final = 20
"""Number of onsets on the recording's clock from which offsets to try are computed: each is paired with every onset of
the other file. A single onset would not suffice, since its pulse may be missing in the other file.
"""

TOLERANCE_S: Final = 0.02
"""Maximum difference in s of matched onsets. Markers from another program jitter, and a signal may have a low sampling
rate.
"""

LEAST_SHARE: Final = 0.5
"""Minimum share of the pulses in the common time that must be matched, in each of the two files."""

RIVAL_SHARE: Final = 0.75
"""If another offset matches at least this share of the number of starts and ends that the best offset matches, the
pulses do not decide between the two offsets. This happens with evenly spaced pulses. It also happens with equally long
pulses whose ends are unknown in one file: the known starts may match the starts or the ends in the other file.
"""

LEAST_SIGMA_S: Final = 0.001
"""Minimum standard deviation of an onset in s. The value is the standard deviation of the error if the onset is at a
random time between two samples at 300 Hz.
"""

ROUNDS: Final = 5
"""Number of rounds in which the clock's drift and the sigma of the onsets are fitted in turn."""

HIGH, LOW = 0.6, 0.4
"""A pulse begins above ``HIGH`` and ends below ``LOW``, on a scale from a signal's extreme outside pulses (0) to its
extreme within pulses (1).
"""


@dataclass(frozen=True, slots=True, eq=False)
class Pulses:
    """Pulses on one clock. start_s (p,), end_s (q,): increasing times of their starts and ends; end_s is empty if the
    ends are unknown.
    """

    start_s: np.ndarray
    end_s: np.ndarray = field(default_factory=lambda: np.empty(0))


def pulses_of_signal(time_s: np.ndarray, values: np.ndarray) -> tuple[Pulses, Pulses]:
    """Return both readings of a signal with values (n,) at times (n,), since a signal does not state which of its
    levels is the pulse: each pulse starts at a rising edge and ends at a falling edge, or vice versa.
    """
    rising_s, falling_s = rising_edges(time_s, values), rising_edges(time_s, -values)
    return Pulses(rising_s, falling_s), Pulses(falling_s, rising_s)


def rising_edges(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the times (p,) at which a signal with values (n,) at times (n,) rises; NaN values are left out.

    An edge is the time, interpolated linearly between two samples, at which the signal crosses the mean of its lowest
    and its highest value.
    """
    known = np.isfinite(values)
    times, heights = time_s[known], values[known]
    if len(heights) < 2 or np.ptp(heights) <= 0.0:
        return np.empty(0)
    level = (heights - heights.min()) / np.ptp(heights)
    sample = np.arange(len(level))
    # at each sample, the index of the last sample that was above ``HIGH`` or below ``LOW``
    clear = np.maximum.accumulate(np.where((level >= HIGH) | (level <= LOW), sample, 0))
    is_high = level[clear] >= HIGH
    begun = np.flatnonzero(is_high[1:] & ~is_high[:-1]) + 1
    below = np.maximum.accumulate(np.where(level < 0.5, sample, 0))[begun]
    share = (0.5 - level[below]) / (level[below + 1] - level[below])
    return np.asarray(times[below] + share * (times[below + 1] - times[below]))


@dataclass(frozen=True, slots=True, eq=False)
class _Trial:
    """One reading (interpretation of edges as starts or ends) of the pulses in each file, with the offsets tried for
    this pair. offsets (c, 2): each row is an offset between the clocks, and the time on the recording's clock at which
    this offset holds; matched (c,): how many starts and ends match at each offset.
    """

    ours: Pulses
    theirs: Pulses
    offsets: np.ndarray
    matched: np.ndarray

    @property
    def most(self) -> int:
        return int(self.matched.max(initial=0))

    @property
    def offset(self) -> np.ndarray:
        """Return the row (2,) of ``offsets`` at which most starts and ends match."""
        return np.asarray(self.offsets[np.argmax(self.matched)])

    def starts(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the starts (k,) on the recording's clock and on the other clock that match at the best offset."""
        mine, theirs = _matched(self.ours.start_s, self.theirs.start_s, *self.offset)
        return self.ours.start_s[mine], self.theirs.start_s[theirs]


def find_pulse_clock(
    ours: Sequence[Pulses], theirs: Sequence[Pulses], near_s: float | None = None
) -> tuple[OtherClock, int]:
    """Find the other device's clock; return it and the number of matched pulses. ours, theirs: the possible readings of
    the pulses, which interpret edges as starts or as ends, on the recording's clock and on the other clock
    (``pulses_of_signal``).

    near_s: an offset that is correct within half a second, None if unknown. Raises NoCommonMovement if too few pulses
    match, or another offset matches nearly as many starts and ends, in the same or in another reading. If pulses are
    very short, the offsets that follow from two readings may differ by less than the pulses' jitter. Then the offset
    lies midway between both, and its sigma includes their difference.
    """
    trials = [_tried(mine, other, near_s) for mine in ours for other in theirs]
    best = max(trials, key=lambda trial: trial.most)
    if not len(best.offsets):
        none = any(not len(each.start_s) for each in (*ours, *theirs))
        raise NoCommonMovement("one of the two has no pulse" if none else "no pulses lie as far apart as --near states")
    _require_enough(best, near_s)
    rivals = [trial for trial in trials if trial.most >= RIVAL_SHARE * best.most]
    for trial in rivals:
        _require_no_other_offset(best, trial)
    clock = _fitted(*best.starts())
    middle_s = np.array([clock.middle_s])
    readings_s = [float((_fitted(*each.starts()).reference_time_s(middle_s) - middle_s)[0]) for each in rivals]
    apart_s = float(np.ptp(readings_s))
    if apart_s > TOLERANCE_S:
        worst = int(np.argmax(np.abs(np.array(readings_s) - clock.offset_s)))
        raise _ambiguous(best, readings_s[worst], rivals[worst].most)
    midway_s, sigma_s = min(readings_s) + apart_s / 2.0, float(np.hypot(clock.offset_sigma_s, apart_s / 2.0))
    return replace(clock, offset_s=midway_s, offset_sigma_s=sigma_s), len(best.starts()[0])


def _require_no_other_offset(best: _Trial, trial: _Trial) -> None:
    """Raise NoCommonMovement if in ``trial``, an offset that clearly differs from the best offset matches nearly as
    many starts and ends as the best offset.
    """
    far = np.abs(trial.offsets[:, 0] - best.offset[0]) > 5.0 * TOLERANCE_S
    matched = np.where(far, trial.matched, 0)
    if matched.max() >= RIVAL_SHARE * best.most:
        raise _ambiguous(best, float(trial.offsets[np.argmax(matched), 0]), int(matched.max()))


def _ambiguous(best: _Trial, offset_s: float, matched: int) -> NoCommonMovement:
    both = f"offsets of {best.offset[0]:.2f} and {offset_s:.2f} s"
    return NoCommonMovement(f"{both} match {best.most} and {matched} starts and ends of pulses")


def _tried(ours: Pulses, theirs: Pulses, near_s: float | None) -> _Trial:
    offsets = _candidates(ours.start_s, theirs.start_s, near_s)
    edges = ((ours.start_s, theirs.start_s), (ours.end_s, theirs.end_s))
    known = [(mine, other) for mine, other in edges if len(mine) and len(other)]
    matched = [sum(len(_matched(mine, other, *each)[0]) for mine, other in known) for each in offsets]
    return _Trial(ours, theirs, offsets, np.array(matched, dtype=int))


def _candidates(ours_s: np.ndarray, theirs_s: np.ndarray, near_s: float | None) -> np.ndarray:
    """Return the offsets between the two clocks that are tried, (c, 2). The first column is the offset: an onset on the
    other clock minus an onset on the recording's clock. The second is this onset on the recording's clock, the time at
    which the offset holds.
    """
    if not len(ours_s):
        return np.empty((0, 2))
    anchors = ours_s[np.unique(np.linspace(0, len(ours_s) - 1, ANCHORS).astype(int))]
    tried = np.array([(theirs - anchor, anchor) for anchor in anchors for theirs in theirs_s]).reshape(-1, 2)
    return tried if near_s is None else tried[np.abs(tried[:, 0] - near_s) <= RIVAL_DISTANCE_S]


def _matched(
    ours_s: np.ndarray, theirs_s: np.ndarray, offset_s: float, anchor_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices (k,) into ours_s and (k,) into theirs_s of the onsets that match if the clocks differ by
    ``offset_s``. The tolerance grows with the time from ``anchor_s``, at which the offset holds, since clocks drift.
    """
    within_s = TOLERANCE_S + 2.0 * DRIFT_SIGMA * np.abs(ours_s - anchor_s)
    found = nearest_within(ours_s + offset_s, theirs_s, within_s)
    return np.flatnonzero(found >= 0), found[found >= 0]


def _require_enough(trial: _Trial, near_s: float | None) -> None:
    """Raise NoCommonMovement if too few of the pulses' starts match at the best offset."""
    least, matched = LEAST_PULSES if near_s is None else 1, len(trial.starts()[0])
    if matched < least:
        raise NoCommonMovement(f"{matched} pulses match, and {least} are needed")
    ours_s, there_s = trial.ours.start_s, trial.theirs.start_s - trial.offset[0]
    from_s, to_s = max(ours_s[0], there_s[0]) - TOLERANCE_S, min(ours_s[-1], there_s[-1]) + TOLERANCE_S
    most = max(int(((each >= from_s) & (each <= to_s)).sum()) for each in (ours_s, there_s))
    if matched < LEAST_SHARE * most:
        raise NoCommonMovement(f"only {matched} of {most} pulses match")


def _fitted(ours_s: np.ndarray, theirs_s: np.ndarray) -> OtherClock:
    """Fit offset and drift of the clock to matched onsets (k,); the drift has a prior of 0 ± ``DRIFT_SIGMA``."""
    middle_s, ahead_s = float(ours_s.mean()), theirs_s - ours_s
    since_s, offset_s = ours_s - middle_s, float(ahead_s.mean())
    sigma_s, drift, information = TOLERANCE_S / 2.0, 0.0, DRIFT_SIGMA**-2
    for _ in range(ROUNDS):  # the first round uses an assumed sigma
        information = float((since_s**2).sum()) / sigma_s**2 + DRIFT_SIGMA**-2
        drift = float((since_s * (ahead_s - offset_s)).sum()) / sigma_s**2 / information
        left_s = ahead_s - offset_s - drift * since_s
        if len(left_s) >= LEAST_PULSES:
            sigma_s = max(LEAST_SIGMA_S, float(np.std(left_s, ddof=1)))
    return OtherClock(
        offset_s=offset_s,
        offset_sigma_s=sigma_s / float(np.sqrt(len(ours_s))),
        drift=drift,
        drift_sigma=information**-0.5,
        middle_s=middle_s,
        overlap_s=(float(ours_s[0]), float(ours_s[-1])),
    )
