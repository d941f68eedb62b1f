"""Reference movements as pose vectors, at all speeds, and the index that finds a similar one (paper, Section IV).

A pose vector theta does not depend on where the patient stands and faces. It holds 21 x 3 joint positions relative to
SpineBase in the trunk's heading frame (X where the trunk faces, Y up, Z to its right), then a path of 4: SpineBase
along X, Y, Z of the *momentary* heading frame, summed from step to step like an odometer, and the heading, radians,
unwrapped. Only differences of the path mean anything.

The scaled set D_s is never written out: a sub-list is a place in the clips, as recorded, and how many of their frames
pass in one frame of the recording; its poses are interpolated when they are needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from anchorpose.joints import JOINT_COUNT, JOINT_INDEX

COMPARED: Final = 3 * JOINT_COUNT
"""Columns of a pose vector that say how similar two poses are."""

SEGMENT: Final = 4  # neighbours in time with a common bound; more of them lie farther apart than they save tests
COLUMNS: Final = 16  # principal columns of the bounds, which with these come to nine tenths of the cost
_SAMPLES: Final = 5000  # poses that the principal directions are taken from

_ROOT: Final = JOINT_INDEX["SpineBase"]
_LEFT: Final = [JOINT_INDEX["HipLeft"], JOINT_INDEX["ShoulderLeft"]]
_RIGHT: Final = [JOINT_INDEX["HipRight"], JOINT_INDEX["ShoulderRight"]]


class SubLists(NamedTuple):
    """The sub-lists, w of them; those of one clip and speed stand together, in the order of time.

    place (w,) float64: row of theta, also between two rows, of the newest pose. stride (w,) float64: rows per frame.
    followed (w,) int32: frames that come after it in its clip.
    summary (w, 2, COLUMNS) float32: mean pose and displacement, in the leading columns of ``turned``.
    segment (s + 1,) int64: where each group of neighbours begins; centre (s, 2, COLUMNS) float32: the mean of their
    summaries; radius (s, 2) float32: how far from that their mean poses, and their displacements, lie at most.
    """

    place: np.ndarray
    stride: np.ndarray
    followed: np.ndarray
    summary: np.ndarray
    segment: np.ndarray
    centre: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class MotionDatabase:
    """Reference movements D, end to end, and the sub-lists of D_s.

    theta (n, d) float32, at the rates they were recorded with. The first ``compared`` columns decide how similar two
    poses are; the others (a path over the floor, whose origin means nothing) are only predicted.
    turned (n, compared) float32 = theta[:, :compared] @ basis, basis orthonormal: the same distances, but the first
    columns hold most of them.
    """

    theta: np.ndarray
    compared: int
    turned: np.ndarray
    basis: np.ndarray
    sublists: SubLists


def pose_vectors(joints_m: np.ndarray) -> np.ndarray:
    """(t, 67) float64 pose vectors of consecutive frames of joints (t, 21, 3) world metres; NaN is kept."""
    heading = heading_rad(joints_m)
    root = joints_m[:, _ROOT]
    relative = _turned(joints_m - root[:, None], -heading)
    steps = _turned(np.diff(root, axis=0)[:, None], -heading[:-1])[:, 0]
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    turned = heading.copy()
    known = np.isfinite(heading)
    turned[known] = np.unwrap(heading[known])
    return np.concatenate([relative.reshape(len(joints_m), -1), path, turned[:, None]], axis=1)


def joints_after(last_m: np.ndarray, last_theta: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """(steps, 21, 3) world joints of pose vectors (steps, 67) that follow the frame ``last_m`` (21, 3)."""
    headings = theta[:, -1]
    before = np.concatenate([last_theta[-1:], headings[:-1]])
    steps = np.diff(np.concatenate([last_theta[None, -4:-1], theta[:, -4:-1]]), axis=0)
    root = last_m[_ROOT] + np.cumsum(_turned(steps[:, None], before)[:, 0], axis=0)
    relative = theta[:, :COMPARED].reshape(-1, JOINT_COUNT, 3)
    return _turned(relative, headings) + root[:, None]


def heading_rad(joints_m: np.ndarray) -> np.ndarray:
    """(t,) turn about Y from world X to where the trunk faces: across hips and shoulders, whichever are known."""
    across = joints_m[:, _RIGHT] - joints_m[:, _LEFT]
    across = np.where(np.isfinite(across).all(axis=(2,), keepdims=True), across, 0.0).sum(axis=1)
    unknown = np.linalg.norm(across[:, [0, 2]], axis=1) == 0.0
    return np.where(unknown, np.nan, np.arctan2(across[:, 0], across[:, 2]))


def _turned(vectors: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    """(t, n, 3) vectors turned about Y by one angle (t,) per frame."""
    cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.stack([cos * x + sin * z, y, cos * z - sin * x], axis=-1)


def build_database(
    clips: Sequence[np.ndarray],
    rate_hz: Sequence[float],
    at_hz: float,
    compared: int,
    speeds: Sequence[float],
    history: int,
    past: int,
) -> MotionDatabase:
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


def summarise(turned: np.ndarray, place: np.ndarray, stride: np.ndarray, history: int) -> np.ndarray:
    """(w, 2, COLUMNS) float32: mean pose and displacement of sub-lists of ``history`` poses, in the leading columns."""
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
    """The sub-lists of runs: first row of a clip, rows per frame, and how many frames it holds."""
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
    summary = summarise(turned, places, strides, history)
    centre, radius = _enclose(summary, begins)
    return SubLists(places, strides, np.concatenate(followed).astype(np.int32), summary, begins, centre, radius)


def _enclose(summary: np.ndarray, segment: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre and radius of the summaries of each segment."""
    size = np.diff(segment)
    centre = (np.add.reduceat(summary, segment[:-1], axis=0) / size[:, None, None]).astype(np.float32)
    away = np.linalg.norm(summary - np.repeat(centre, size, axis=0), axis=2)
    return centre, np.maximum.reduceat(away, segment[:-1], axis=0).astype(np.float32)
