"""Reference movements at all speeds, and what finds a similar one in them without looking at all (paper, Section IV).

The scaled set D_s is never written out: a sub-list is a place in the clips, as recorded, and how many of their frames
pass in one frame of the recording; its poses are interpolated when they are looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

SEGMENT: Final = 4  # neighbours in time with a common bound; more of them lie farther apart than they save tests
COLUMNS: Final = 16  # principal columns of the bounds, which with these come to nine tenths of the cost
_SAMPLES: Final = 5000  # poses that the principal directions are taken from


@dataclass(frozen=True, slots=True, eq=False)
class SubLists:
    """Which sub-lists there are, w of them; those of one clip and speed stand together, in the order of time.

    place (w,) float64: row of theta, between two rows also, of the newest pose. stride (w,) float64: rows a frame.
    followed (w,) int32: frames that come after it in its clip.
    told (w, 2, COLUMNS) float32: its mean pose and the way it moved, in the leading columns of ``turned``.
    segment (s + 1,) int64: where each group of neighbours begins; centre (s, 2, COLUMNS) float32 the mean of what is
    told of them, and radius (s, 2) float32 how far from that the mean poses, and the ways moved, lie at most.
    """

    place: np.ndarray
    stride: np.ndarray
    followed: np.ndarray
    told: np.ndarray
    segment: np.ndarray
    centre: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class MotionDatabase:
    """Reference movements D, end to end, and the sub-lists of D_s.

    theta (n, d) float32, at the rates they were recorded with. The first ``compared`` columns decide how similar two
    poses are; the others (a path over the floor, whose origin means nothing) are only predicted.
    turned (n, compared) float32 = theta[:, :compared] @ basis, basis orthonormal: the same distances, but the first
    columns tell most of them.
    """

    theta: np.ndarray
    compared: int
    turned: np.ndarray
    basis: np.ndarray
    sublists: SubLists


def build_database(
    clips: Sequence[np.ndarray], rate_hz: Sequence[float], at_hz: float, compared: int, speeds: Sequence[float],
    history: int, past: int,
) -> MotionDatabase:  # fmt: skip
    """D_s of clips, (n_i, d) each, recorded at ``rate_hz`` each, for a recording of ``at_hz``.

    history: poses of a sub-list; past: frames that its clip must hold before its newest one (at least the others).
    Raises ValueError where a clip holds missing values, or no clip is long enough for the past and one step.
    """
    if any(not np.isfinite(clip).all() for clip in clips):
        raise ValueError("a clip of the motion database has missing values; cut it there")
    start = np.cumsum([0, *(len(clip) for clip in clips)])
    runs = []
    for first, end, rate in zip(start[:-1], start[1:], rate_hz, strict=True):
        for speed in speeds:
            stride = speed * rate / at_hz
            frames = int((end - 1 - first) / stride + 1e-9) + 1
            if frames > past + 1:
                runs.append((first, stride, frames))
    if not runs:
        raise ValueError(f"no clip of the motion database is longer than {past + 1} frames")
    theta = np.concatenate(clips).astype(np.float32)
    basis = _principal(theta[:, :compared])
    turned = theta[:, :compared] @ basis
    return MotionDatabase(theta, compared, turned, basis, _list(runs, turned, history, past))


def poses_at(theta: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(..., d): rows of ``theta`` at fractional places (...), linear in between."""
    low = place.astype(np.int64)
    share = (place - low)[..., None].astype(np.float32)
    return theta[low] * (1.0 - share) + theta[np.minimum(low + 1, len(theta) - 1)] * share


def tell(turned: np.ndarray, place: np.ndarray, stride: np.ndarray, history: int) -> np.ndarray:
    """(w, 2, COLUMNS) float32: mean pose and way moved of sub-lists of ``history`` poses, in the leading columns."""
    leading = turned[:, :COLUMNS].astype(np.float32)
    total = poses_at(leading, place)
    moved = total.copy()
    for back in range(1, history):
        pose = poses_at(leading, place - back * stride)
        total += pose
    return np.stack([total / np.float32(history), moved - pose], axis=1)


def _principal(poses: np.ndarray) -> np.ndarray:
    """(d, d) float32 orthonormal, the direction in which poses differ most first."""
    some = poses[:: max(1, len(poses) // _SAMPLES)].astype(np.float64)
    apart = some - some.mean(axis=0)
    return np.linalg.eigh(apart.T @ apart)[1][:, ::-1].astype(np.float32)


def _list(runs: Sequence[tuple[int, float, int]], turned: np.ndarray, history: int, past: int) -> SubLists:
    place, stride, followed, segment = [], [], [], [np.zeros(1, dtype=np.int64)]
    listed = 0
    for first, rows, frames in runs:
        newest = np.arange(past, frames - 1)
        place.append(first + newest * rows)
        stride.append(np.full(len(newest), rows))
        followed.append(frames - 1 - newest)
        listed += len(newest)
        segment.append(np.append(np.arange(listed - len(newest), listed, SEGMENT)[1:], listed))
    places, strides, begins = np.concatenate(place), np.concatenate(stride), np.concatenate(segment)
    told = tell(turned, places, strides, history)
    centre, radius = _enclose(told, begins)
    return SubLists(places, strides, np.concatenate(followed).astype(np.int32), told, begins, centre, radius)


def _enclose(told: np.ndarray, segment: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre and radius of what is told of each segment."""
    size = np.diff(segment)
    centre = (np.add.reduceat(told, segment[:-1], axis=0) / size[:, None, None]).astype(np.float32)
    away = np.linalg.norm(told - np.repeat(centre, size, axis=0), axis=2)
    return centre, np.maximum.reduceat(away, segment[:-1], axis=0).astype(np.float32)
