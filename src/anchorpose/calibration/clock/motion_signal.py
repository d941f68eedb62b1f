"""How much moves at each height, over time: a signal that cameras share wherever they stand.

Each camera sees another side of a body, so what it sees of a movement differs in size but not in time. The change of
depth, added up in bands of height over the floor, needs no pose, no background and no people found.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
from scipy.ndimage import gaussian_filter1d

from anchorpose.camera import Camera

BANDS_M = np.linspace(0.1, 2.0, 9)  # edges; below is the floor, above nobody
FAR_JUMP_M = 0.08  # in three pictures: more is another surface that appears, and counts no more for being far behind


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalConfig:
    """How signals are made and compared."""

    step_px: int = 4  # every fourth pixel of every fourth row: a body still has 900
    noise_gate: float = 4.0  # sigmas of the difference of two readings
    smooth_s: float = 0.1  # two pictures at 15 Hz; limbs start and stop in 0.2 s
    least_overlap_s: float = 1.5  # one movement
    least_overlap: float = 0.6  # of the shorter signal: over less, chance agrees as well as truth
    apart_s: float = 0.4  # a second peak nearer than this belongs to the first
    least_peak: float = (
        0.4  # correlation, likewise; right ones were 0.41 to 0.84 on simulated clinics, wrong ones to 0.42
    )
    sure_lead: float = 2.0  # times the second peak, to be believed without a closer look
    peaks: int = 4  # looked at more closely where none is sure

    def __post_init__(self) -> None:
        for entry in fields(self):
            if not getattr(self, entry.name) > 0:
                raise ValueError(f"{entry.name} must be positive, got {getattr(self, entry.name)}")


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """Heights from one camera's pictures: up (3,) unit, camera frame; height_m of the camera, over any fixed level."""

    up: np.ndarray
    height_m: float


@dataclass(frozen=True, slots=True, eq=False)
class MotionSignal:
    """time_s (n,) own clock; speed (n, bands): root of the area times speed that changed in each band of height."""

    time_s: np.ndarray
    speed: np.ndarray


@dataclass(frozen=True, slots=True)
class SignalLag:
    """lag_s: the second clock less the first at one moment; peak: correlation there; second: the best elsewhere."""

    lag_s: float
    peak: float
    second: float

    def sure(self, config: SignalConfig) -> bool:
        """Whether the peak stands out far enough to be believed by itself."""
        return self.peak >= max(config.least_peak, config.sure_lead * self.second)


def motion_signal(
    pictures: Iterable[tuple[float, np.ndarray]],
    camera: Camera,
    level: Level | None,
    noise: float,
    config: SignalConfig,
) -> MotionSignal:
    """The signal of consecutive pictures (time, depth (height, width) float32, 0 = no reading) of one camera.

    level: None where no floor is known; then all heights are one band. noise: the factor of ``calibration.noise``.
    """
    step = slice(config.step_px // 2, None, config.step_px)
    small = [(time_s, depth[step, step]) for time_s, depth in pictures]
    rays = camera.pixel_rays()[step, step]
    times, speeds = [], []
    for (before_s, before), (now_s, now), (after_s, after) in zip(small, small[1:], small[2:], strict=False):
        change = np.abs(after - before) - config.noise_gate * noise * now**2
        seen = (before > 0) & (now > 0) & (after > 0) & (change > 0)
        amount = np.minimum(change, FAR_JUMP_M)[seen] * now[seen] ** 2 / (after_s - before_s)
        times.append(now_s)
        speeds.append(np.sqrt(np.bincount(_bands(rays[seen], now[seen], level), amount, len(BANDS_M) + 1)[1:-1]))
    return MotionSignal(np.array(times), np.array(speeds).reshape(len(times), len(BANDS_M) - 1))


def signal_lags(
    first: MotionSignal, second: MotionSignal, around_s: float, reach_s: float, config: SignalConfig
) -> tuple[SignalLag, ...]:
    """The lags within ``reach_s`` of ``around_s`` at which the changes of both signals agree best, the best first.

    The correlation is taken over all bands together, so that bands in which little moves have little say. The peak is
    placed between the steps of half a picture by the parabola through it and its neighbours.
    """
    if min(len(first.time_s), len(second.time_s)) < 3:
        return ()
    step_s = 0.5 * min(float(np.median(np.diff(signal.time_s))) for signal in (first, second))
    x, y = (_changes(signal, step_s, config.smooth_s) for signal in (first, second))
    start_s = second.time_s[0] - first.time_s[0]  # the lag at which both begin together
    shifts = np.arange(
        int(np.ceil((around_s - reach_s - start_s) / step_s)), int((around_s + reach_s - start_s) / step_s) + 1
    )
    least = int(max(config.least_overlap_s / step_s, config.least_overlap * min(len(x), len(y))))
    score = np.array([_correlation(x, y, int(shift), least) for shift in shifts])
    peaks, left = list[int](), np.where(np.isfinite(score), score, -np.inf)
    while len(peaks) < config.peaks and np.isfinite(left).any():
        peaks.append(int(left.argmax()))
        left[np.abs(shifts - shifts[peaks[-1]]) * step_s <= config.apart_s] = -np.inf
    best = [float(score[peak]) for peak in peaks]
    return tuple(
        SignalLag(
            float(start_s + (shifts[peak] + _vertex(score, peak)) * step_s),
            best[k],
            max(best[:k] + best[k + 1 :], default=0.0),
        )
        for k, peak in enumerate(peaks)
    )


def _bands(rays: np.ndarray, depth_m: np.ndarray, level: Level | None) -> np.ndarray:
    if level is None:
        return np.ones(len(depth_m), dtype=np.int64)
    height = (rays @ level.up[:2] + level.up[2]) * depth_m + level.height_m
    return np.digitize(height, BANDS_M)


def _changes(signal: MotionSignal, step_s: float, smooth_s: float) -> np.ndarray:
    """(m, bands) smoothed rate of change on an even grid that starts with the signal."""
    grid = np.arange(signal.time_s[0], signal.time_s[-1], step_s)
    even = np.stack([np.interp(grid, signal.time_s, band) for band in signal.speed.T], axis=1)
    rate: np.ndarray = gaussian_filter1d(even, smooth_s / step_s, axis=0, order=1)
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
    if not 0 < best < len(score) - 1 or not np.isfinite(score[best - 1 : best + 2]).all():
        return 0.0
    left, middle, right = score[best - 1 : best + 2]
    return float(0.5 * (left - right) / (left - 2.0 * middle + right))
