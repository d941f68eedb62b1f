"""Pairing the pictures of several cameras by time (real cameras are not synchronised, and frames drop).

What is missing of each camera, in one sentence a camera instead of one a frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.recording import Recording

LONE_PICTURE_PERIOD_S: Final = 1.0 / 30.0
"""The usual period of a depth camera: the only clue where the reference camera has a single picture."""


@lru_cache(maxsize=8)  # frames are read one by one, and every one asks
def pair_frames(
    recording: Recording, reference: int = 0, clock_offset_s: tuple[float, ...] | None = None
) -> np.ndarray:
    """(n, cameras) int64: for each picture of the reference camera, the index of each camera's picture; -1 = none.

    A pair is the nearest in time of each other, within half a period of the reference camera, so no picture is used
    twice. A doubled picture shows another moment than its time says and is nobody's pair; in the reference camera it
    leaves a frame without that camera's picture. ``clock_offset_s``, one a camera, is added to that camera's clock to
    give the reference clock; None when the clocks agree. The answer is read only.
    Raises InputError where a camera never meets the reference camera.
    """
    offsets = clock_offset_s if clock_offset_s is not None else (0.0,) * len(recording.cameras)
    if len(offsets) != len(recording.cameras):
        raise ValueError(f"{len(offsets)} clock offsets given for {len(recording.cameras)} cameras")
    times = [stream.time_s + offset for stream, offset in zip(recording.streams, offsets, strict=True)]
    within_s = half_period_s(times[reference])
    pairs = np.stack(
        [
            _pair_camera(times[reference], other, stream.doubled, within_s)
            for other, stream in zip(times, recording.streams, strict=True)
        ],
        axis=1,
    )
    doubled = recording.streams[reference].doubled
    if doubled is not None:
        pairs[doubled, reference] = -1
    for index, camera in enumerate(recording.cameras):
        if (pairs[:, index] < 0).all():
            name = recording.cameras[reference].name
            spans = f"{_span(times[index])}, {_span(times[reference])}"
            problem = f"camera {camera.name} never overlaps in time with camera {name} ({spans})"
            remedy = "check that both belong to one recording and put their clocks together"
            timestamps = recording.folder / camera.name / "timestamps.csv"
            path = timestamps if timestamps.exists() else recording.folder / "recording.json"
            raise InputError(path, problem, remedy)
    pairs.setflags(write=False)
    return pairs


def _pair_camera(
    reference_s: np.ndarray, other_s: np.ndarray, doubled: np.ndarray | None, within_s: float
) -> np.ndarray:
    usable = np.flatnonzero(~doubled) if doubled is not None else np.arange(len(other_s))
    match = nearest_within(reference_s, other_s[usable], within_s)
    return np.where(match >= 0, usable[match], -1)


def half_period_s(time_s: np.ndarray) -> float:
    """Half of the median time between pictures (n,); that of a usual depth camera where there is only one."""
    return float(np.median(np.diff(time_s)) if len(time_s) > 1 else LONE_PICTURE_PERIOD_S) / 2.0


def nearest_within(time_s: np.ndarray, other_s: np.ndarray, within_s: float) -> np.ndarray:
    """(n,) int64: index into ``other_s`` (m,) of the mutually nearest time; -1 where none lies within ``within_s``."""
    there, back = _nearest(time_s, other_s), _nearest(other_s, time_s)
    mutual = back[there] == np.arange(len(time_s))
    # a nanosecond of slack: times written with six decimals must not fall out of an exact half period
    close = np.abs(other_s[there] - time_s) <= within_s + 1e-9
    return np.where(mutual & close, there, -1)


def _nearest(time_s: np.ndarray, other_s: np.ndarray) -> np.ndarray:
    after = np.clip(np.searchsorted(other_s, time_s), 1, len(other_s) - 1) if len(other_s) > 1 else None
    if after is None:
        return np.zeros(len(time_s), dtype=np.int64)
    earlier = time_s - other_s[after - 1] <= other_s[after] - time_s
    return (after - earlier).astype(np.int64)


def _span(time_s: np.ndarray) -> str:
    return f"{time_s[0]:.3f} to {time_s[-1]:.3f} s"


PAUSE_S: Final = 1.0
"""A longer stretch without pictures is told apart from dropped ones."""


@dataclass(frozen=True, slots=True)
class CameraGaps:
    """What one camera's stream lacks, on the reference clock.

    pictures: usable files; dropped: missing between its first and last, by its own usual period, pauses left out;
    doubled, repeated: left out because the picture or the time is that of the file before; late_s, early_s: how much
    later it starts and earlier it ends than the first camera (0 where it does not); pauses: (from, to) without
    pictures; paired_share: of the first camera's frames that have a picture of this one.
    """

    camera: str
    pictures: int
    dropped: int
    doubled: int
    repeated: int
    late_s: float
    early_s: float
    pauses: tuple[tuple[float, float], ...]
    paired_share: float

    @property
    def sentence(self) -> str:
        """What people should know; empty where nothing is missing."""
        parts = []
        if self.dropped:
            parts.append(f"{self.dropped} of {self.pictures + self.dropped} pictures are missing")
        if self.doubled:
            parts.append(f"{self.doubled} hold the picture before once more and were left out")
        if self.repeated:
            parts.append(f"{self.repeated} have the time of the one before and were left out")
        if self.late_s:
            parts.append(f"it starts {self.late_s:.1f} s late")
        if self.early_s:
            parts.append(f"it ends {self.early_s:.1f} s early")
        parts += [f"it has no pictures from {begin_s:.1f} to {end_s:.1f} s" for begin_s, end_s in self.pauses]
        return f"camera {self.camera}: {'; '.join(parts)}" if parts else ""


def find_gaps(recording: Recording) -> tuple[CameraGaps, ...]:
    """One a camera; the times of ``recording`` are on the reference clock (``recording.clock``)."""
    pairs, reference_s = pair_frames(recording), recording.streams[0].time_s
    return tuple(_of_camera(recording, index, pairs[:, index], reference_s) for index in range(len(recording.cameras)))


def _of_camera(recording: Recording, index: int, pair: np.ndarray, reference_s: np.ndarray) -> CameraGaps:
    stream = recording.streams[index]
    time_s = stream.time_s
    steps = np.diff(time_s)
    period_s = float(np.median(steps)) if len(steps) else 0.0
    paused = steps > max(PAUSE_S, 3.0 * period_s)
    missing = np.rint(steps / period_s) - 1.0 if len(steps) else np.zeros(0)
    doubled = 0 if stream.doubled is None else int(stream.doubled.sum())
    late_s, early_s = float(time_s[0] - reference_s[0]), float(reference_s[-1] - time_s[-1])
    return CameraGaps(
        camera=recording.cameras[index].name,
        pictures=len(time_s) - doubled,
        dropped=int(np.maximum(missing, 0.0)[~paused].sum()),
        doubled=doubled,
        repeated=stream.repeated,
        late_s=late_s if late_s > PAUSE_S else 0.0,
        early_s=early_s if early_s > PAUSE_S else 0.0,
        pauses=tuple((float(time_s[k]), float(time_s[k + 1])) for k in np.flatnonzero(paused)),
        paired_share=float((pair >= 0).mean()),
    )
