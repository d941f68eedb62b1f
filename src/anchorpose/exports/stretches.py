"""Stretches without a gap, for formats that cannot say that something is missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

KEPT_SHARE: Final = 0.5
"""A column that is known in less than this share of the frames would cost the others more frames than it is worth."""

LEAST_FRAMES: Final = 2
"""One frame is no motion."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """kept (c,) bool: columns that are written; runs: first and one past the last frame of each stretch in which all of
    these are known."""

    kept: np.ndarray
    runs: tuple[tuple[int, int], ...]


def stretches_of(known: np.ndarray, joined: np.ndarray | None = None) -> Stretches:
    """known (n, c) bool: what is there in each frame; joined as in ``runs_where``. No run where no column is known in
    half of the frames."""
    kept = known.mean(axis=0) >= KEPT_SHARE
    return Stretches(kept, runs_where(np.asarray(known[:, kept].all(axis=1)), joined) if kept.any() else ())


def runs_where(whole: np.ndarray, joined: np.ndarray | None = None) -> tuple[tuple[int, int], ...]:
    """First and one past the last of the frames that stand together in ``whole`` (n,) bool, two at least.

    joined (n - 1,) bool: whether a frame and the next one are neighbours in time; None where all are.
    """
    together = whole[:-1] & whole[1:] & (True if joined is None else joined)
    starts = np.flatnonzero(whole & ~np.concatenate([[False], together]))
    ends = np.flatnonzero(whole & ~np.concatenate([together, [False]])) + 1
    long = ends - starts >= LEAST_FRAMES
    return tuple(zip(starts[long].tolist(), ends[long].tolist(), strict=True))


def stretch_name(stem: str, suffix: str, number: int, count: int) -> str:
    """``motion.mot``, or ``motion_001.mot`` where there are several stretches."""
    return f"{stem}{suffix}" if count == 1 else f"{stem}_{number + 1:03d}{suffix}"
