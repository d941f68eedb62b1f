"""How long each frame stands for."""

from __future__ import annotations

from typing import Final

import numpy as np

LONGEST_STEP: Final = 1.5
"""Times the usual step between frames. A longer one means that frames are missing: what happened then is not known."""


def usual_step_s(time_s: np.ndarray) -> float:
    """The median step between frames; NaN of fewer than two."""
    return float(np.median(np.diff(time_s))) if len(time_s) > 1 else float("nan")


def frame_seconds(time_s: np.ndarray) -> np.ndarray:
    """(n,) seconds: half the way to both neighbours, half a usual step where there is none or frames are missing.

    All zeros of a single frame, which has no duration.
    """
    if len(time_s) < 2:
        return np.zeros(len(time_s))
    usual, step = usual_step_s(time_s), np.diff(time_s)
    half = 0.5 * np.where(step > LONGEST_STEP * usual, usual, step)
    return np.append(0.5 * usual, half) + np.append(half, 0.5 * usual)


def unbroken_runs(chosen: np.ndarray, time_s: np.ndarray) -> list[slice]:
    """Stretches of frames that are all ``chosen`` (n,) bool, ended also where frames are missing."""
    if not len(chosen):
        return []
    joined = np.append(False, np.diff(time_s) <= LONGEST_STEP * usual_step_s(time_s))  # to the frame before
    starts = np.flatnonzero(chosen & ~(joined & np.append(False, chosen[:-1])))
    ends = np.flatnonzero(chosen & ~np.append(joined[1:] & chosen[1:], False))
    return [slice(int(start), int(end) + 1) for start, end in zip(starts, ends, strict=True)]
