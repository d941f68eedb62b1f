"""The lags between the cameras' clocks: roughly from signals of motion, then finely from shared surfaces.

Surfaces alone would need every lag to be tried on full depth frames; signals alone are off by 10 to 60 ms, because
cameras on different sides see different parts of a movement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations, pairwise
from typing import Final

import numpy as np

from anchorpose.calibration.clock_fit import DRIFT_SIGMA, PairLag
from anchorpose.calibration.clock_signal import Level, MotionSignal, SignalLag, motion_signal, signal_lags
from anchorpose.calibration.clock_surfaces import Clip, make_clip, surface_lag
from anchorpose.calibration.noise import noise_per_m
from anchorpose.camera import Camera
from anchorpose.recording.depth_image import DepthFrames

FRAMES_KEPT: Final = 300  # 260 MB of a Kinect v2's
MOST_AHEAD_S: Final = 5.0  # how far clocks of one epoch may be apart
MOST_LATE_S: Final = 15.0  # between the starts of two recorders whose clocks have nothing in common
BLOCK_S: Final = 12.0  # of frames for the signals: several movements
BLOCKS: Final = 3  # tried for the signals, the busiest first
WINDOW_S: Final = 2.0  # of frames for the surfaces
REACH_S: Final = 0.12  # twice the largest error that the signals ever had
SYSTEMATIC_S: Final = 0.001  # error of a window whatever its residuals are: 1 mm of the sensor at 1 m/s
LEAST_WINDOWS: Final = 2  # that must agree where the signals are not certain
LEAST_FRAMES: Final = 8  # what a window needs at 4 Hz

STEP_PX: Final = 8  # every eighth pixel of every eighth row shows how much moves
APART_S: Final = 0.2  # between the two frames that are compared
LEAST_CHANGE_M, MOST_CHANGE_M = 0.02, 0.15  # noise; and another surface that appears


@dataclass(slots=True, eq=False)
class FrameCache:
    """Depth frames on demand; counts what is read and keeps the latest: windows of a short recording overlap."""

    source: DepthFrames
    read_count: int = 0
    kept: dict[tuple[int, int], np.ndarray | None] = field(default_factory=dict)

    @property
    def cameras(self) -> tuple[Camera, ...]:
        return self.source.cameras

    @property
    def times_s(self) -> tuple[np.ndarray, ...]:
        return self.source.times_s

    def read(self, camera: int, position: int) -> np.ndarray | None:
        """(height, width) float32 metres, or None."""
        if (camera, position) not in self.kept:
            self.read_count += 1
            if len(self.kept) >= FRAMES_KEPT:
                del self.kept[next(iter(self.kept))]
            self.kept[camera, position] = self.source.read(camera, position)
        return self.kept[camera, position]

    def between(self, camera: int, begin_s: float, end_s: float) -> list[tuple[float, np.ndarray]]:
        """(time, depth) of the usable frames of a camera between two times of its clock."""
        times_s = self.times_s[camera]
        first, last = np.searchsorted(times_s, [begin_s, end_s])
        found = ((float(times_s[k]), self.read(camera, k)) for k in range(first, last))
        return [(time_s, depth) for time_s, depth in found if depth is not None]


@dataclass(frozen=True, slots=True)
class RoughLag:
    """lag_s: the camera's clock less the reference's, at about at_s, within ``REACH_S``; certain: no check needed."""

    lag_s: float
    at_s: float
    reach_s: float = REACH_S
    certain: bool = False


REFERENCE: Final = RoughLag(0.0, 0.0, 0.0, True)  # of the first camera against itself


def busiest_times(
    frames: FrameCache, span_s: tuple[float, float], windows: int, places: int
) -> list[tuple[float, float]]:
    """(time on the reference clock, how much moves there in m^3) of the busiest place of each of ``windows`` parts.

    Each part of ``span_s`` is sampled at ``places`` places, two frames each; a part without frames has no entry.
    """
    edges = np.linspace(*span_s, windows + 1)
    found = []
    for begin_s, end_s in pairwise(edges):
        sampled = begin_s + (np.arange(places) + 0.5) * (end_s - begin_s) / places
        amount, time_s = max((_motion(frames, time_s), float(time_s)) for time_s in sampled)
        if amount >= 0:
            found.append((time_s, amount))
    return found


def _motion(frames: FrameCache, time_s: float) -> float:
    """Area times change between two frames of the reference camera; -1 where they are missing."""
    times_s = frames.times_s[0]
    first, last = np.clip(np.searchsorted(times_s, [time_s, time_s + APART_S]), 0, len(times_s) - 1)
    if first == last:
        return -1.0
    before, after = frames.read(0, int(first)), frames.read(0, int(last))
    if before is None or after is None:
        return -1.0
    lens = frames.cameras[0].intrinsics
    before, after = before[::STEP_PX, ::STEP_PX], after[::STEP_PX, ::STEP_PX]
    change = np.abs(after - before)
    moved = (before > 0) & (after > 0) & (change > LEAST_CHANGE_M)
    near = np.minimum(before, after)[moved]
    return float((np.minimum(change[moved], MOST_CHANGE_M) * near**2).sum() * STEP_PX**2 / (lens.fx * lens.fy))


def rough_lags(frames: FrameCache, levels: Sequence[Level | None], busiest_s: Sequence[float]) -> list[RoughLag | None]:
    """The lag of each camera from signals; the surfaces choose between a certain one and the lag of the time stamps,
    or, where none is certain, among the best of them all. None where neither gives one."""
    same = [level if all(other is not None for other in levels) else None for level in levels]
    rough: list[RoughLag | None] = [REFERENCE, *[None] * (len(levels) - 1)]
    possible = [_from_stamps(frames, camera) for camera in range(len(levels))]
    for at_s in _blocks(frames.times_s[0], busiest_s):
        reference = _block_signal(frames, 0, at_s, BLOCK_S / 2, same[0])
        for camera in (camera for camera, found in enumerate(rough) if found is None):
            lags = _best_lags(frames, camera, at_s, reference, same[camera])
            found = [RoughLag(lag.lag_s, at_s, certain=lag.is_certain) for lag in lags]
            rough[camera] = found[0] if found and found[0].certain else None
            possible[camera] += found
    for camera in range(1, len(rough)):
        certain, stamped = rough[camera], _from_stamps(frames, camera)
        if certain is None:
            rough[camera] = _best_by_surfaces(frames, camera, possible[camera], busiest_s[:LEAST_WINDOWS])
        elif stamped and abs(certain.lag_s) > REACH_S:
            rough[camera] = _best_by_surfaces(frames, camera, [*stamped, certain], busiest_s[:LEAST_WINDOWS]) or certain
    return rough


def stamped_lags(frames: FrameCache) -> list[RoughLag | None]:
    """No lag of each camera whose time stamps and the first camera's may be of one clock; None for others."""
    stamped = [_from_stamps(frames, camera) for camera in range(1, len(frames.cameras))]
    return [REFERENCE, *(found[0] if found else None for found in stamped)]


def _blocks(times_s: np.ndarray, busiest_s: Sequence[float]) -> list[float]:
    """Middles of the blocks for the signals: the busiest, none reaching beyond the recording, all different."""
    low, high = times_s[0] + BLOCK_S / 2, times_s[-1] - BLOCK_S / 2
    if low >= high:
        return [float(times_s[0] + times_s[-1]) / 2]
    inside = [float(np.clip(at_s, low, high)) for at_s in busiest_s]
    apart = [at_s for k, at_s in enumerate(inside) if all(abs(at_s - other) > BLOCK_S / 2 for other in inside[:k])]
    return apart[:BLOCKS]


def _from_stamps(frames: FrameCache, camera: int) -> list[RoughLag]:
    """Clocks that agree, where they are of one epoch."""
    around_s, _ = _guesses(frames.times_s[0], frames.times_s[camera])[0]
    at_s = float(frames.times_s[0][len(frames.times_s[0]) // 2])
    return [RoughLag(0.0, at_s)] if around_s == 0.0 else []


def _guesses(reference_s: np.ndarray, other_s: np.ndarray) -> list[tuple[float, float]]:
    """(lag, reach) to search about: clocks of one epoch, or recorders started together."""
    common_s = min(reference_s[-1], other_s[-1]) - max(reference_s[0], other_s[0])
    together = (float(other_s[0] - reference_s[0]), MOST_LATE_S)
    half_s = 0.5 * min(np.ptp(reference_s), np.ptp(other_s))
    return [(0.0, MOST_AHEAD_S), together] if common_s > half_s - MOST_AHEAD_S else [together]


def _best_lags(
    frames: FrameCache, camera: int, at_s: float, reference: MotionSignal, level: Level | None
) -> list[SignalLag]:
    """The lags about each guess, the best first."""
    found: list[SignalLag] = []
    for around_s, reach_s in _guesses(frames.times_s[0], frames.times_s[camera]):
        signal = _block_signal(frames, camera, at_s + around_s, BLOCK_S / 2 + reach_s, level)
        found += signal_lags(reference, signal, around_s, reach_s)
        if found and found[0].is_certain:
            break
    return sorted(found, key=lambda lag: -lag.peak)


def _block_signal(frames: FrameCache, camera: int, at_s: float, half_s: float, level: Level | None) -> MotionSignal:
    block = frames.between(camera, at_s - half_s, at_s + half_s)
    if len(block) < 3:
        return MotionSignal(np.empty(0), np.empty((0, 1)))
    noise = noise_per_m([block[0][1], block[-1][1]])
    return motion_signal(block, frames.cameras[camera], level, noise)


def _best_by_surfaces(
    frames: FrameCache, camera: int, possible: Sequence[RoughLag], times_s: Sequence[float]
) -> RoughLag | None:
    """The lag at which this camera's surfaces fit the reference camera's best; None where no lag can be tested."""
    best, least_m = None, np.inf
    reference = RoughLag(0.0, 0.0)
    clips = [_clip(frames, 0, at_s, reference) for at_s in times_s]
    for rough in possible:
        misfits = []
        for at_s, first in zip(times_s, clips, strict=True):
            other = _clip(frames, camera, at_s, rough)
            if first is not None and other is not None:
                found = surface_lag(first, other, rough.lag_s, rough.reach_s)
                misfits += [] if found is None else [found.misfit_m]
        if misfits and np.mean(misfits) < least_m:
            best, least_m = rough, float(np.mean(misfits))
    return best


def fine_lags(frames: FrameCache, rough: Sequence[RoughLag | None], times_s: Sequence[float]) -> list[PairLag]:
    """The lags of all pairs of posed cameras in every window, less the rough ones: times may count from 1970."""
    lags = []
    for at_s in times_s:
        clips = [_clip(frames, camera, at_s, found) for camera, found in enumerate(rough)]
        for first, second in combinations(range(len(rough)), 2):
            one, other = clips[first], clips[second]
            a, b = rough[first], rough[second]
            if one is None or other is None or a is None or b is None:
                continue
            far_s = max(abs(at_s - found.at_s) for found in (a, b) if found is not rough[0])
            reach_s = max(a.reach_s, b.reach_s) + 2.0 * DRIFT_SIGMA * far_s
            lag = surface_lag(one, other, b.lag_s - a.lag_s, reach_s)
            if lag is not None:
                sigma_s = float(np.hypot(lag.sigma_s, SYSTEMATIC_S))
                lags.append(PairLag(first, second, at_s, lag.lag_s - (b.lag_s - a.lag_s), sigma_s))
    return lags


def _clip(frames: FrameCache, camera: int, at_s: float, rough: RoughLag | None) -> Clip | None:
    """The window's frames of a camera, extended by the error of its clock; None with too few frames or no pose."""
    if rough is None or frames.cameras[camera].T_world_camera is None:
        return None
    half_s = WINDOW_S / 2 + rough.reach_s
    window = frames.between(camera, at_s + rough.lag_s - half_s, at_s + rough.lag_s + half_s)
    return make_clip(frames.cameras[camera], window) if len(window) >= LEAST_FRAMES else None
