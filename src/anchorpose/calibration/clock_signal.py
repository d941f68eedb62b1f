"""How much moves at each height, over time: a signal that cameras share wherever they stand.

Each camera sees another side of a body, so a movement differs in size between cameras but not in time. The change of
depth, summed in bands of height over the floor, needs no pose, no background and no detection of people.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from anchorpose.camera import Camera

BANDS_M: Final = np.linspace(0.1, 2.0, 9)  # edges; below is the floor, above nobody
FAR_JUMP_M: Final = 0.08  # within three frames: more is another surface that appears, however far behind it lies
STEP_PX: Final = 4  # every fourth pixel of every fourth row: a body still has 900
NOISE_GATE: Final = 4.0  # sigmas of the difference of two readings
SMOOTH_S: Final = 0.1  # two frames at 15 Hz; limbs start and stop in 0.2 s
LEAST_OVERLAP_S: Final = 1.5  # one movement
LEAST_OVERLAP: Final = 0.6  # of the shorter signal: over less, chance agrees as well as truth
APART_S: Final = 0.4  # a second peak nearer than this belongs to the first
LEAST_PEAK: Final = 0.4  # correlation; on simulated clinics right lags had 0.41 to 0.84, wrong ones up to 0.42
CERTAIN_LEAD: Final = 2.0  # times the second peak, to be accepted without a check by surfaces
PEAKS: Final = 4  # checked by surfaces where none is certain


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """Heights from one camera's frames: up (3,) unit, camera frame; height_m of the camera, over any fixed level."""

    up: np.ndarray
    height_m: float


@dataclass(frozen=True, slots=True, eq=False)
class MotionSignal:
    """time_s (n,) of the camera's clock; speed (n, bands): root of the area times speed that changed in each band."""

    time_s: np.ndarray
    speed: np.ndarray


@dataclass(frozen=True, slots=True)
class SignalLag:
    """lag_s: the second clock less the first at one moment; peak: correlation there; second: the best elsewhere."""

    lag_s: float
    peak: float
    second: float

    @property
    def is_certain(self) -> bool:
        """Whether the peak stands out far enough to be accepted by itself."""
        return self.peak >= max(LEAST_PEAK, CERTAIN_LEAD * self.second)


def pose_level(camera: Camera) -> Level | None:
    """Heights by a known pose: the world's Y; None where the pose is unknown."""
    if camera.T_world_camera is None:
        return None
    return Level(camera.T_world_camera[1, :3], float(camera.T_world_camera[1, 3]))


def motion_signal(
    frames: Iterable[tuple[float, np.ndarray]], camera: Camera, level: Level | None, noise: float
) -> MotionSignal:
    """The signal of consecutive frames (time, depth (height, width) float32, 0 = no reading) of one camera.

    level: None where no floor is known; then all heights are one band. noise: the factor of ``calibration.noise``.
    """
    step = slice(STEP_PX // 2, None, STEP_PX)
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
    """The lags within ``reach_s`` of ``around_s`` at which the changes of both signals agree best, the best first.

    The correlation is taken over all bands together, so that bands in which little moves count little. The peak is
    placed between the steps of half a frame by the parabola through it and its neighbours.
    """
    if min(len(first.time_s), len(second.time_s)) < 3:
        return ()
    step_s = 0.5 * min(float(np.median(np.diff(signal.time_s))) for signal in (first, second))
    x, y = (_changes(signal, step_s) for signal in (first, second))
    start_s = second.time_s[0] - first.time_s[0]  # the lag at which both begin together
    shifts = np.arange(
        int(np.ceil((around_s - reach_s - start_s) / step_s)), int((around_s + reach_s - start_s) / step_s) + 1
    )
    least = int(max(LEAST_OVERLAP_S / step_s, LEAST_OVERLAP * min(len(x), len(y))))
    score = np.array([_correlation(x, y, int(shift), least) for shift in shifts])
    peaks, left = list[int](), np.where(np.isfinite(score), score, -np.inf)
    while len(peaks) < PEAKS and np.isfinite(left).any():
        peaks.append(int(left.argmax()))
        left[np.abs(shifts - shifts[peaks[-1]]) * step_s <= APART_S] = -np.inf
    best = [float(score[peak]) for peak in peaks]
    lags = [float(start_s + (shifts[peak] + _vertex(score, peak)) * step_s) for peak in peaks]
    return tuple(SignalLag(lag, best[k], max(best[:k] + best[k + 1 :], default=0.0)) for k, lag in enumerate(lags))


def _bands(rays: np.ndarray, depth_m: np.ndarray, level: Level | None) -> np.ndarray:
    if level is None:
        return np.ones(len(depth_m), dtype=np.int64)
    height = (rays @ level.up[:2] + level.up[2]) * depth_m + level.height_m
    return np.digitize(height, BANDS_M)


def _changes(signal: MotionSignal, step_s: float) -> np.ndarray:
    """(m, bands) smoothed rate of change on an even grid that starts with the signal."""
    grid = np.arange(signal.time_s[0], signal.time_s[-1], step_s)
    even = np.stack([np.interp(grid, signal.time_s, band) for band in signal.speed.T], axis=1)
    rate: np.ndarray = gaussian_filter1d(even, SMOOTH_S / step_s, axis=0, order=1)
    return rate


def _correlation(x: np.ndarray, y: np.ndarray, shift: int, least: int) -> float:
    """Of x with y, ``shift`` steps later; NaN where they share fewer than ``least`` steps."""
    begin, end = max(0, -shift), min(len(x), len(y) - shift)
    if end - begin < least:
        return float("nan")
    mine, other = x[begin:end], y[begin + shift : end + shift]
    size = float(np.sqrt((mine**2).sum() * (other**2).sum()))
    return float((mine * other).sum()) / size if size > 0 else float("nan")


def _vertex(score: np.ndarray, best: int) -> float:
    """Where the parabola through a score and its neighbours peaks, in steps from it."""
    if not 0 < best < len(score) - 1 or not np.isfinite(score[best - 1 : best + 2]).all():
        return 0.0
    left, middle, right = score[best - 1 : best + 2]
    return float(0.5 * (left - right) / (left - 2.0 * middle + right))
