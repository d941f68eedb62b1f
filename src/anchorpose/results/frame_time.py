"""Compute the time that each frame represents, and find missing frames and runs of frames."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

LONGEST_STEP: Final = 1.5
"""Maximum time between successive frames, as a multiple of the usual time; if more time passes, a frame is missing."""

ONE_DROPPED: Final = 2.5
"""Maximum time between two successive frames of one movement, as a multiple of the usual time. So a single dropped
frame does not end the movement. Two dropped frames do, since a fast movement may begin and end between them.
"""

LONGEST_GAP_S: Final = 0.5
"""A gap between frames of at most this length in s is too short for sitting down or standing up. If the patient has the
same posture before and after a gap this short, the posture is taken to have continued in the gap. What happened in a
longer gap is unknown.
"""


FRAMES_AT_ONCE: Final = 4096
"""Number of frames processed at once; their intermediate values, or their text for a file, take some megabytes."""


def blocks(frames: int, at_once: int | None = None) -> Iterator[slice]:
    """Yield slices that cover the rows from 0 to ``frames``, ``at_once`` rows each (None: ``FRAMES_AT_ONCE``).
    Computations that need much more memory than their results process the rows of one slice at a time.
    """
    at_once = FRAMES_AT_ONCE if at_once is None else at_once
    for first in range(0, frames, at_once):
        yield slice(first, min(first + at_once, frames))


def usual_step_s(time_s: np.ndarray) -> float:
    """Return the median time between frames; NaN for fewer than two frames."""
    return float(np.median(np.diff(time_s))) if len(time_s) > 1 else float("nan")


def longest_even_step_s(time_s: np.ndarray) -> float:
    """Return the time in s between successive frames above which a frame counts as missing between them; filters must
    not bridge such a gap. The result is NaN for fewer than two frames.
    """
    return LONGEST_STEP * usual_step_s(time_s)


def longest_dropped_s(time_s: np.ndarray) -> float:
    """Return the maximum time in s between successive frames of one movement: ``ONE_DROPPED`` times the usual time
    between frames, so that one dropped frame does not end the movement; NaN for fewer than two frames.
    """
    return ONE_DROPPED * usual_step_s(time_s)


def longest_known_gap_s(time_s: np.ndarray) -> float:
    """Return the time in s between two frames above which it is unknown what happened: ``LONGEST_GAP_S``, or for slow
    cameras ``LONGEST_STEP`` times the usual time between frames.
    """
    return max(LONGEST_GAP_S, longest_even_step_s(time_s))


def recorded_seconds(time_s: np.ndarray) -> float:
    """Return the time in s from the first frame to the end of the last frame, which lasts the usual time between
    frames; 0 for a single frame, which has no duration.
    """
    return float(time_s[-1] - time_s[0]) + usual_step_s(time_s) if len(time_s) > 1 else 0.0


def frame_seconds(time_s: np.ndarray) -> np.ndarray:
    """Return the seconds (n,) that each frame represents: half of the time to the previous frame plus half of the time
    to the next. Half of the usual time is used at the recording's ends and at gaps above ``longest_known_gap_s``.

    A single frame has no duration, so the result is 0. The sum is ``recorded_seconds`` if each gap above
    ``longest_known_gap_s`` counts as one usual time between frames.
    """
    if len(time_s) < 2:
        return np.zeros(len(time_s))
    usual, step = usual_step_s(time_s), np.diff(time_s)
    half = 0.5 * np.where(step > longest_known_gap_s(time_s), usual, step)
    return np.append(0.5 * usual, half) + np.append(half, 0.5 * usual)


def runs_of_known(chosen: np.ndarray, known: np.ndarray, time_s: np.ndarray) -> list[slice]:
    """Leave out all frames that are not ``known`` (n,) bool, and return the unbroken runs of ``chosen`` frames among
    the remaining frames.

    A run continues after a moment in which a joint is lost. A run may contain unknown frames, but does not begin or end
    with an unknown frame.
    """
    rows = np.flatnonzero(known)
    runs = unbroken_runs(chosen[rows], time_s[rows], longest_known_gap_s(time_s))
    return [slice(int(rows[run.start]), int(rows[run.stop - 1]) + 1) for run in runs]


def unbroken_runs(chosen: np.ndarray, time_s: np.ndarray, longest_step_s: float | None = None) -> list[slice]:
    """Return runs of frames that are all ``chosen`` (n,) bool; a gap longer than longest_step_s also ends a run.

    longest_step_s: if None, ``longest_known_gap_s`` is used, so that a dropped frame does not end a run.
    """
    longest_s = longest_known_gap_s(time_s) if longest_step_s is None else longest_step_s
    return runs_of(chosen, np.diff(time_s) <= longest_s)


def followed(known: np.ndarray, time_s: np.ndarray, seconds: float) -> np.ndarray:
    """Return (n,) bool: ``known`` frames after which all frames of the next ``seconds`` are known and at most a single
    frame is dropped at a time. Near the end of the recording, only the frames up to the last frame must be known.
    """
    found = np.zeros(len(known), dtype=bool)
    for run in unbroken_runs(known, time_s, longest_dropped_s(time_s)):
        last = run.stop == len(known)
        found[run] = last | (time_s[run.stop - 1] - time_s[run] >= seconds)
    return found


def runs_of(chosen: np.ndarray, joined: np.ndarray | None = None) -> list[slice]:
    """Return runs of True in ``chosen`` (n,) bool.

    joined (n - 1,) bool: whether a row and the next row may be in the same run; None if all may.
    """
    together = chosen[:-1] & chosen[1:] & (True if joined is None else joined)
    starts = np.flatnonzero(chosen & ~np.append(False, together)[: len(chosen)])
    ends = np.flatnonzero(chosen & ~np.append(together, False)[: len(chosen)])
    return [slice(start, end + 1) for start, end in zip(starts.tolist(), ends.tolist(), strict=True)]


def worst_rows(badness: np.ndarray, time_s: np.ndarray, apart_s: float, most: int) -> list[int]:
    """Return at most ``most`` rows in the order of decreasing badness (n,). Rows within ``apart_s`` of a worse row are
    left out, and so are rows with NaN.
    """
    chosen: list[int] = []
    for row in np.argsort(-badness, kind="stable"):
        if np.isnan(badness[row]) or len(chosen) == most:
            break
        if all(abs(time_s[row] - time_s[other]) >= apart_s for other in chosen):
            chosen.append(int(row))
    return chosen
