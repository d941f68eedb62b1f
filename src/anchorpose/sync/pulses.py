"""Find another device's clock from pulses that both devices recorded, by matching the pulses' onsets."""

from __future__ import annotations

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
"""If another offset matches at least this share of the number of pulses that the best offset matches, the pulses are
too evenly spaced to decide between the two offsets.
"""

LEAST_SIGMA_S: Final = 0.001
"""Minimum standard deviation of an onset in s. The value is the error of an onset at a random time between two samples
at 300 Hz.
"""

ROUNDS: Final = 5
"""Number of rounds in which the clock's drift and the sigma of the onsets are fitted in turn."""

HIGH, LOW = 0.6, 0.4
"""A pulse begins above ``HIGH`` and ends below ``LOW``, on a scale from a signal's extreme outside pulses (0) to its
extreme within pulses (1).
"""


def rising_onsets(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the times (p,) at which pulses begin in a signal with values (n,) at times (n,); NaN values are left out.

    The rarer of the signal's two levels is the pulse, so pulses may also be negative. An onset is the time,
    interpolated linearly between two samples, at which the signal crosses the mean of its lowest and its highest value.
    """
    known = np.isfinite(values)
    times, heights = time_s[known], values[known]
    if len(heights) < 2 or np.ptp(heights) <= 0.0:
        return np.empty(0)
    level = (heights - heights.min()) / np.ptp(heights)
    level = 1.0 - level if (level > 0.5).mean() > 0.5 else level
    sample = np.arange(len(level))
    # at each sample, the index of the last sample that was above ``HIGH`` or below ``LOW``
    clear = np.maximum.accumulate(np.where((level >= HIGH) | (level <= LOW), sample, 0))
    is_high = level[clear] >= HIGH
    begun = np.flatnonzero(is_high[1:] & ~is_high[:-1]) + 1
    below = np.maximum.accumulate(np.where(level < 0.5, sample, 0))[begun]
    share = (0.5 - level[below]) / (level[below + 1] - level[below])
    return np.asarray(times[below] + share * (times[below + 1] - times[below]))


def find_pulse_clock(ours_s: np.ndarray, theirs_s: np.ndarray, near_s: float | None = None) -> tuple[OtherClock, int]:
    """Find the other device's clock; return it and the number of matched pulses. ours_s (n,), theirs_s (m,): increasing
    onsets of the pulses on the recording's clock and on the other clock.

    near_s: an offset that is correct within half a second, None if unknown. Raises NoCommonMovement if too few pulses
    match, or another offset matches nearly as many.
    """
    if not len(ours_s) or not len(theirs_s):
        raise NoCommonMovement("one of the two has no pulse")
    tried = _candidates(ours_s, theirs_s, near_s)
    counts = np.array([len(_matched(ours_s, theirs_s, *each)[0]) for each in tried])
    if not len(counts):
        raise NoCommonMovement("no pulses lie as far apart as --near states")
    best = int(np.argmax(counts))
    far = np.abs(tried[:, 0] - tried[best, 0]) > 5.0 * TOLERANCE_S
    rivals = np.flatnonzero(far & (counts >= RIVAL_SHARE * counts[best]))
    _require_enough(ours_s, theirs_s, float(tried[best, 0]), int(counts[best]), near_s)
    if len(rivals):
        other = tried[rivals[np.argmax(counts[rivals])], 0]
        raise NoCommonMovement(
            f"offsets of {tried[best, 0]:.2f} and {other:.2f} s match {counts[best]} and {counts[rivals].max()} pulses"
        )
    mine, theirs = _matched(ours_s, theirs_s, *tried[best])
    return _fitted(ours_s[mine], theirs_s[theirs]), len(mine)


def _candidates(ours_s: np.ndarray, theirs_s: np.ndarray, near_s: float | None) -> np.ndarray:
    """Return the offsets to try (c, 2). The first column is the offset: an onset on the other clock minus an onset on
    the recording's clock. The second is this onset on the recording's clock, the time at which the offset holds.
    """
    anchors = ours_s[np.unique(np.linspace(0, len(ours_s) - 1, ANCHORS).astype(int))]
    tried = np.array([(theirs - anchor, anchor) for anchor in anchors for theirs in theirs_s])
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


def _require_enough(
    ours_s: np.ndarray, theirs_s: np.ndarray, offset_s: float, matched: int, near_s: float | None
) -> None:
    least = LEAST_PULSES if near_s is None else 1
    if matched < least:
        raise NoCommonMovement(f"{matched} pulses match, and {least} are needed")
    there_s = theirs_s - offset_s
    from_s, to_s = max(ours_s[0], there_s[0]) - TOLERANCE_S, min(ours_s[-1], there_s[-1]) + TOLERANCE_S
    most = max(int(((each >= from_s) & (each <= to_s)).sum()) for each in (ours_s, there_s))
    if matched < LEAST_SHARE * most:
        raise NoCommonMovement(f"only {matched} of {most} pulses match")


def _fitted(ours_s: np.ndarray, theirs_s: np.ndarray) -> OtherClock:
    """Fit offset and drift of the clock to matched onsets (k,); the drift has a prior of 0 ± ``DRIFT_SIGMA``."""
    middle_s, ahead_s = float(ours_s.mean()), theirs_s - ours_s
    since_s, offset_s = ours_s - middle_s, float(ahead_s.mean())
    sigma_s, drift, information = TOLERANCE_S / 2.0, 0.0, DRIFT_SIGMA**-2
    for _ in range(ROUNDS):  # sigma is unknown in the first round
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
