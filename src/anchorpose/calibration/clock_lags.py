"""Measure the lags between the cameras' clocks (a lag is the difference between two clocks at the same moment): first
roughly from signals of motion, then precisely from the surfaces that two cameras see.

Cameras see different sides of a body, so a movement looks larger in one camera than in another. But all cameras see the
movement at the same time. The signal of motion is the change of depth, summed separately in each band of height above
the floor. This signal needs neither poses, nor a background, nor a detection of people. But lags from signals are off
by 10 to 60 ms, because cameras on different sides see different parts of a movement. Lags from surfaces are precise,
but without signals every possible lag would have to be tried on full depth frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from anchorpose.calibration.clock_surfaces import Clip, make_clip, surface_lag
from anchorpose.calibration.first_frames import FloorPlane, noise_per_m
from anchorpose.camera import Camera
from anchorpose.recording.depth_image import RecordedFrames

# m above the floor, edges of the height bands; readings of the floor are below the lowest edge, and nobody reaches
# above the highest edge
BANDS_M: Final = np.linspace(0.1, 2.0, 9)
# m, maximum change of a pixel's depth from a frame to the second frame after it; a larger change counts as this value,
# because the pixel then shows another surface
FAR_JUMP_M: Final = 0.08
# pixels; every fourth pixel of every fourth row is used, which still leaves 900 pixels of a body
SIGNAL_STEP_PX: Final = 4
# sigmas of one reading's noise, subtracted from each change of depth; smaller changes count as noise
NOISE_GATE: Final = 4.0
SMOOTH_S: Final = 0.1  # s, sigma of the Gaussian that smooths a signal; limbs start and stop in 0.2 s
LEAST_OVERLAP_S: Final = 1.5  # s, minimum overlap of two signals: about the duration of one movement
# minimum overlap of two signals in time, as a share of the shorter signal; with less overlap, the signals may by chance
# correlate at a wrong lag as well as at the correct lag
LEAST_OVERLAP: Final = 0.6
PEAKS_APART_S: Final = 0.4  # s, minimum distance between two peaks of the correlation; nearer peaks count as one
# minimum correlation for a lag to count as certain; on simulated clinics, correct lags had 0.41 to 0.84, wrong lags up
# to 0.42
LEAST_PEAK: Final = 0.4
CERTAIN_LEAD: Final = 2.0  # minimum ratio of the highest to the second peak for a lag to need no check by surfaces
PEAKS: Final = 4  # number of peaks whose lags are checked by surfaces if no peak is certain


@dataclass(frozen=True, slots=True, eq=False)
class MotionSignal:
    """A camera's motion over time. time_s (n,): times on its clock; speed (n, bands): for each band of height, square
    root of the sum of (area times rate of change of depth) over the band's pixels.
    """

    time_s: np.ndarray
    speed: np.ndarray


@dataclass(frozen=True, slots=True)
class SignalLag:
    """A lag between two clocks, estimated from their cameras' signals of motion. lag_s: the second clock minus the
    first at the same moment; peak: correlation at this lag; is_certain: whether the peak stands out enough from all
    other peaks for its lag to be accepted without a check by surfaces.
    """

    lag_s: float
    peak: float
    is_certain: bool


def motion_signal(
    frames: Iterable[tuple[float, np.ndarray]], camera: Camera, level: FloorPlane | None, noise: float
) -> MotionSignal:
    """Compute one camera's motion signal from consecutive frames (time, depth (height, width) float32, 0 = no reading).

    level: the floor; None if unknown: all heights are then one band. noise: factor a (1/m) of the sensor's noise,
    which has sigma a z^2 at depth z (``first_frames.noise_per_m``).
    """
    step = slice(SIGNAL_STEP_PX // 2, None, SIGNAL_STEP_PX)
    small = [(time_s, depth[step, step]) for time_s, depth in frames]
    rays = camera.pixel_rays()[step, step]
    times, speeds = [], []
    for (before_s, before), (now_s, now), (after_s, after) in zip(small, small[1:], small[2:], strict=False):
        change = np.abs(after - before) - NOISE_GATE * noise * now**2
        seen = (before > 0) & (now > 0) & (after > 0) & (change > 0)
        amount = np.minimum(change, FAR_JUMP_M)[seen] * now[seen] ** 2 / (after_s - before_s)
        times.append(now_s)
        speeds.append(np.sqrt(np.bincount(_bands(rays[seen], now[seen], level), amount, len(BANDS_M) + 1)[1:-1]))
    return MotionSignal(np.array(times), np.array(speeds).reshape(len(times), len(BANDS_M) - 1))


def signal_lags(first: MotionSignal, second: MotionSignal, around_s: float, reach_s: float) -> tuple[SignalLag, ...]:
    """Return the lags within ``reach_s`` of ``around_s`` at which both signals agree best; the best lag comes first.

    The correlation is computed over all bands together, so that bands with little movement have little weight. Lags are
    tried in steps of half a frame's period; a parabola through the correlations at three neighbouring lags gives the
    lag of the peak.
    """
    if min(len(first.time_s), len(second.time_s)) < 3:
        return ()
    step_s = 0.5 * min(float(np.median(np.diff(signal.time_s))) for signal in (first, second))
    x, y = (_changes(signal, step_s) for signal in (first, second))
    start_s = second.time_s[0] - first.time_s[0]  # lag at which both signals begin at the same time
    shifts = np.arange(
        int(np.ceil((around_s - reach_s - start_s) / step_s)), int((around_s + reach_s - start_s) / step_s) + 1
    )
    least = int(max(LEAST_OVERLAP_S / step_s, LEAST_OVERLAP * min(len(x), len(y))))
    score = np.array([_correlation(x, y, int(shift), least) for shift in shifts])
    peaks, left = list[int](), np.where(np.isfinite(score), score, -np.inf)
    while len(peaks) < PEAKS and np.isfinite(left).any():
        peaks.append(int(left.argmax()))
        left[np.abs(shifts - shifts[peaks[-1]]) * step_s <= PEAKS_APART_S] = -np.inf
    best = [float(score[peak]) for peak in peaks]
    lags = [float(start_s + (shifts[peak] + _vertex(score, peak)) * step_s) for peak in peaks]
    others = [max(best[:k] + best[k + 1 :], default=0.0) for k in range(len(best))]
    certain = [peak >= max(LEAST_PEAK, CERTAIN_LEAD * other) for peak, other in zip(best, others, strict=True)]
    return tuple(SignalLag(*found) for found in zip(lags, best, certain, strict=True))


def _bands(rays: np.ndarray, depth_m: np.ndarray, level: FloorPlane | None) -> np.ndarray:
    if level is None:
        return np.ones(len(depth_m), dtype=np.int64)
    height = (rays @ level.up[:2] + level.up[2]) * depth_m + level.height_m
    return np.digitize(height, BANDS_M)


def _changes(signal: MotionSignal, step_s: float) -> np.ndarray:
    """Return (m, bands): for each band of height, the rate of change of the smoothed ``signal.speed``, at m times that
    begin at ``signal.time_s[0]`` and are ``step_s`` apart.
    """
    grid = np.arange(signal.time_s[0], signal.time_s[-1], step_s)
    even = np.stack([np.interp(grid, signal.time_s, band) for band in signal.speed.T], axis=1)
    rate: np.ndarray = gaussian_filter1d(even, SMOOTH_S / step_s, axis=0, order=1)
    return rate


def _correlation(x: np.ndarray, y: np.ndarray, shift: int, least: int) -> float:
    """Correlate x with y at a lag of ``shift`` steps; NaN if they overlap in fewer than ``least`` steps, or if x or y
    is 0 in the whole overlap.
    """
    begin, end = max(0, -shift), min(len(x), len(y) - shift)
    if end - begin < least:
        return float("nan")
    mine, other = x[begin:end], y[begin + shift : end + shift]
    size = float(np.sqrt((mine**2).sum() * (other**2).sum()))
    return float((mine * other).sum()) / size if size > 0 else float("nan")


def _vertex(score: np.ndarray, best: int) -> float:
    """Return the position of the peak of a parabola through the score at ``best`` and its two neighbours, in steps from
    ``best``; 0 if a neighbour is missing.
    """
    if not 0 < best < len(score) - 1 or not np.isfinite(score[best - 1 : best + 2]).all():
        return 0.0
    left, middle, right = score[best - 1 : best + 2]
    return float(0.5 * (left - right) / (left - 2.0 * middle + right))


MOST_AHEAD_S: Final = 5.0  # s, maximum difference between two clocks that count from the same epoch
MOST_LATE_S: Final = 15.0  # s, maximum time between the starts of two recorders with unrelated clocks
# s, duration of a block; the frames of a block give one signal of motion, and people make several movements in 12 s
BLOCK_S: Final = 12.0
BLOCKS: Final = 3  # number of blocks whose signals are compared; blocks with most movement come first
WINDOW_S: Final = 2.0  # s, duration of a window; the surfaces in its frames are compared between cameras
REACH_S: Final = 0.12  # s, maximum error of a lag from signals: twice the largest error that was found
# s, systematic error of a lag that is measured in one window (``WINDOW_S``); on a surface that moves at 1 m/s, an error
# of 1 mm in the sensor's depth causes this error of the lag
SYSTEMATIC_S: Final = 0.001
LEAST_WINDOWS: Final = 2  # minimum number of windows whose lags must agree, unless the lag from signals is certain
LEAST_FRAMES: Final = 8  # minimum number of frames in a window: the frames of a camera at 4 Hz in ``WINDOW_S``

DRIFT_SIGMA: Final = 1e-4  # s/s, standard deviation of a drift; a quartz clock is accurate to 100 parts in a million
PLACES: Final = 4  # number of times in each part of the recording at which ``busiest_times`` measures movement
STEP_PX: Final = 8  # pixels; every eighth pixel of every eighth row suffices to measure the amount of movement
APART_S: Final = 0.2  # s, time between the two frames whose difference measures the amount of movement
# m; a change of depth below the first value is ignored as noise. A change of depth above the second value counts as the
# second value, since the pixel then shows another surface
LEAST_CHANGE_M, MOST_CHANGE_M = 0.02, 0.15


@dataclass(frozen=True, slots=True)
class PairLag:
    """The lag of a pair of cameras. lag_s: the clock of camera ``second`` minus the clock of camera ``first``, less
    the pair's rough lag (the difference between the ``RoughLag`` of the two cameras); at_s: the time of this lag, on
    the reference clock (the clock of camera 0).
    """

    first: int
    second: int
    at_s: float
    lag_s: float
    sigma_s: float


@dataclass(frozen=True, slots=True)
class RoughLag:
    """A rough lag of one camera. lag_s: the camera's clock minus the reference clock, at about the time at_s of the
    reference clock; reach_s: maximum error of lag_s; certain: True if the lag need not be checked by comparing
    surfaces.
    """

    lag_s: float
    at_s: float
    reach_s: float = REACH_S
    certain: bool = False


REFERENCE: Final = RoughLag(0.0, 0.0, 0.0, True)  # the lag of the first camera relative to itself


def busiest_times(frames: RecordedFrames, span_s: tuple[float, float], windows: int) -> list[tuple[float, float]]:
    """Return, for each of ``windows`` equal parts of the recording, the time on the reference camera's clock with most
    movement, and the amount of this movement (m^3).

    In each part of ``span_s``, movement is measured at ``PLACES`` times, from two frames each; a part without frames
    has no entry.
    """
    edges = np.linspace(*span_s, windows + 1)
    found = []
    for begin_s, end_s in pairwise(edges):
        sampled = begin_s + (np.arange(PLACES) + 0.5) * (end_s - begin_s) / PLACES
        amount, time_s = max((_motion(frames, time_s), float(time_s)) for time_s in sampled)
        if amount >= 0:
            found.append((time_s, amount))
    return found


def _motion(frames: RecordedFrames, time_s: float) -> float:
    """Return the amount of movement (m^3) between two frames of the reference camera: the sum of area times change of
    depth; -1 if a frame is missing.
    """
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


def rough_lags(
    frames: RecordedFrames, levels: Sequence[FloorPlane | None], busiest_s: Sequence[float]
) -> list[RoughLag | None]:
    """Return each camera's lag, found from signals of motion; None if no lag is found. If no lag of a camera is
    certain, the camera's best lags and the lag by the time stamps are compared, and the lag at which the camera's
    surfaces fit the reference camera's surfaces best is chosen. If a lag that counts as certain contradicts the time
    stamps, surfaces decide in the same way between this lag and the time stamps.
    """
    same = [level if all(other is not None for other in levels) else None for level in levels]
    rough: list[RoughLag | None] = [REFERENCE, *[None] * (len(levels) - 1)]
    stamped = stamped_lags(frames)
    possible = [[] if lag is None else [lag] for lag in stamped]
    for at_s in _blocks(frames.times_s[0], busiest_s):
        reference = _block_signal(frames, 0, at_s, BLOCK_S / 2, same[0])
        for camera in (camera for camera, found in enumerate(rough) if found is None):
            lags = _best_lags(frames, camera, at_s, reference, same[camera])
            found = [RoughLag(lag.lag_s, at_s, certain=lag.is_certain) for lag in lags]
            rough[camera] = found[0] if found and found[0].certain else None
            possible[camera] += found
    for camera in range(1, len(rough)):
        certain, by_stamps = rough[camera], stamped[camera]
        if certain is None:
            rough[camera] = _best_by_surfaces(frames, camera, possible[camera], busiest_s[:LEAST_WINDOWS])
        elif by_stamps is not None and abs(certain.lag_s) > REACH_S:
            tried = [by_stamps, certain]
            rough[camera] = _best_by_surfaces(frames, camera, tried, busiest_s[:LEAST_WINDOWS]) or certain
    return rough


def stamped_lags(frames: RecordedFrames) -> list[RoughLag | None]:
    """Return a lag of zero for each camera whose time stamps may count from the epoch of the first camera's clock, else
    None.
    """
    reference_s = frames.times_s[0]
    zero = RoughLag(0.0, float(reference_s[len(reference_s) // 2]))
    nearest_s = [_guesses(reference_s, other_s)[0][0] for other_s in frames.times_s[1:]]
    return [REFERENCE, *(zero if around_s == 0.0 else None for around_s in nearest_s)]


def _blocks(times_s: np.ndarray, busiest_s: Sequence[float]) -> list[float]:
    """Return the middle times of the blocks (stretches of ``BLOCK_S`` seconds) from which signals are computed, the
    block with most movement first; blocks overlap by less than half.
    """
    low, high = times_s[0] + BLOCK_S / 2, times_s[-1] - BLOCK_S / 2
    if low >= high:
        return [float(times_s[0] + times_s[-1]) / 2]
    inside = [float(np.clip(at_s, low, high)) for at_s in busiest_s]
    apart = [at_s for k, at_s in enumerate(inside) if all(abs(at_s - other) > BLOCK_S / 2 for other in inside[:k])]
    return apart[:BLOCKS]


def _guesses(reference_s: np.ndarray, other_s: np.ndarray) -> list[tuple[float, float]]:
    """Return the lags around which to search, each with its largest error. A lag of 0 is returned because clocks may
    count from the same epoch; it is left out if the two cameras' times hardly overlap. The difference between the two
    clocks' first times is returned because recorders may have been started together.
    """
    common_s = min(reference_s[-1], other_s[-1]) - max(reference_s[0], other_s[0])
    together = (float(other_s[0] - reference_s[0]), MOST_LATE_S)
    half_s = 0.5 * min(np.ptp(reference_s), np.ptp(other_s))
    return [(0.0, MOST_AHEAD_S), together] if common_s > half_s - MOST_AHEAD_S else [together]


def _best_lags(
    frames: RecordedFrames, camera: int, at_s: float, reference: MotionSignal, level: FloorPlane | None
) -> list[SignalLag]:
    """Return the best lags around each lag of ``_guesses``, the best first."""
    found: list[SignalLag] = []
    for around_s, reach_s in _guesses(frames.times_s[0], frames.times_s[camera]):
        signal = _block_signal(frames, camera, at_s + around_s, BLOCK_S / 2 + reach_s, level)
        found += signal_lags(reference, signal, around_s, reach_s)
        if found and found[0].is_certain:
            break
    return sorted(found, key=lambda lag: -lag.peak)


def _block_signal(
    frames: RecordedFrames, camera: int, at_s: float, half_s: float, level: FloorPlane | None
) -> MotionSignal:
    block = _between(frames, camera, at_s - half_s, at_s + half_s)
    if len(block) < 3:
        return MotionSignal(np.empty(0), np.empty((0, 1)))
    noise = noise_per_m([block[0][1], block[-1][1]])
    return motion_signal(block, frames.cameras[camera], level, noise)


def _between(frames: RecordedFrames, camera: int, begin_s: float, end_s: float) -> list[tuple[float, np.ndarray]]:
    """Return (time, depth) of the usable frames of a camera between two times of its clock."""
    times_s = frames.times_s[camera]
    first, last = np.searchsorted(times_s, [begin_s, end_s])
    found = ((float(times_s[k]), frames.read(camera, k)) for k in range(first, last))
    return [(time_s, depth) for time_s, depth in found if depth is not None]


def _best_by_surfaces(
    frames: RecordedFrames, camera: int, possible: Sequence[RoughLag], times_s: Sequence[float]
) -> RoughLag | None:
    """Return the lag at which this camera's surfaces fit the surfaces of the reference camera best; None if no lag can
    be tested.
    """
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


def fine_lags(frames: RecordedFrames, rough: Sequence[RoughLag | None], times_s: Sequence[float]) -> list[PairLag]:
    """Return the lag of each pair of cameras with poses, measured in windows of ``WINDOW_S`` seconds around
    ``times_s``; windows in which a lag cannot be measured are left out. Each lag is stored relative to the pair's rough
    lag: if times count from 1970, the full lag may be so large that digits would be lost.
    """
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


def _clip(frames: RecordedFrames, camera: int, at_s: float, rough: RoughLag | None) -> Clip | None:
    """Return a camera's frames in the window of ``WINDOW_S`` seconds around ``at_s``, extended at both ends by the
    possible error of its rough lag; None if the camera has too few frames there, no rough lag or no pose.
    """
    if rough is None or frames.cameras[camera].T_world_camera is None:
        return None
    half_s = WINDOW_S / 2 + rough.reach_s
    window = _between(frames, camera, at_s + rough.lag_s - half_s, at_s + rough.lag_s + half_s)
    return make_clip(frames.cameras[camera], window) if len(window) >= LEAST_FRAMES else None
