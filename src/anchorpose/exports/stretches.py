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


def stretches_of(known: np.ndarray) -> Stretches:
    """known (n, c) bool: what is there in each frame. No run where no column is known in half of the frames."""
    kept = known.mean(axis=0) >= KEPT_SHARE
    return Stretches(kept, runs_where(np.asarray(known[:, kept].all(axis=1))) if kept.any() else ())


def runs_where(whole: np.ndarray) -> tuple[tuple[int, int], ...]:
    """First and one past the last of the frames that stand together in ``whole`` (n,) bool, two at least."""
    edge = np.diff(whole.astype(np.int8), prepend=0, append=0)
    starts, ends = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
    long = ends - starts >= LEAST_FRAMES
    return tuple(zip(starts[long].tolist(), ends[long].tolist(), strict=True))


def stretch_name(stem: str, suffix: str, number: int, count: int) -> str:
    """``motion.mot``, or ``motion_001.mot`` where there are several stretches."""
    return f"{stem}{suffix}" if count == 1 else f"{stem}_{number + 1:03d}{suffix}"
