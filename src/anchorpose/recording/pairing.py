"""Pairing the pictures of several cameras by time (real cameras are not synchronised, and frames drop)."""

from __future__ import annotations

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
