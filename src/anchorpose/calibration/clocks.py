"""The clocks of all cameras, from what moves before them.

Two steps. How much moves at each height (``motion_signal``) finds the lag among several seconds to about a twentieth of
a second, with or without poses. Where the poses are known, the surfaces that two cameras share (``surface_lag``) then
give it to a millisecond. The second way alone would need every lag to be tried on full pictures; the first alone is off
by 10 to 60 ms, because cameras on other sides see other parts of a movement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import combinations

import numpy as np

from anchorpose.calibration.clock_fit import ClockFit, PairLag, fit_clocks
from anchorpose.calibration.clock_windows import busiest_times, pictures_between
from anchorpose.calibration.motion_signal import Level, MotionSignal, SignalConfig, SignalLag, motion_signal, signal_lag
from anchorpose.calibration.noise import noise_per_m
from anchorpose.calibration.surface_lag import Clip, SurfaceLagConfig, make_clip, surface_lag
from anchorpose.camera import Camera
from anchorpose.recording.clock import Clock
from anchorpose.recording.footage import Footage


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockConfig:
    """How the clocks of several cameras are compared."""

    estimate: bool = True  # False: the stamps are believed as they are
    most_ahead_s: float = 5.0  # how far clocks of one epoch may be apart
    most_late_s: float = 15.0  # between the starts of two recorders whose clocks have nothing in common
    block_s: float = 12.0  # of pictures for the first step: several movements
    blocks: int = 3  # tried for the first step, the busiest first
    window_s: float = 2.0  # of pictures for the second step
    windows: int = 6  # over the whole recording: a drift shows between its ends
    places: int = 4  # looked at in each sixth of the recording, to find where much moves
    reach_s: float = 0.12  # twice what the first step was ever off
    drift_sigma: float = 1e-4  # a quartz is good to 100 parts in a million
    signal_sigma_s: float = 0.03  # of the first step's lags on simulated clinics
    systematic_s: float = 0.001  # of a window, whatever its residuals say: 1 mm of the sensor at 1 m/s
    outlier_gate: float = 5.0  # deviations
    worst_sigma_s: float = 0.008  # at either end of the recording: half of what a pair of pictures is apart anyway
    signal: SignalConfig = field(default_factory=SignalConfig)
    surface: SurfaceLagConfig = field(default_factory=SurfaceLagConfig)

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if isinstance(value, int | float) and not isinstance(value, bool) and not value > 0:
                raise ValueError(f"{name} must be positive, got {value}")


class ClockSource(StrEnum):
    """How a camera's clock is known; people read it in the run's notes."""

    REFERENCE = "the reference"
    SURFACES = "from the surfaces it shares with other cameras"
    SIGNALS = "from how much moves at each height, to a twentieth of a second"
    KEPT = "kept as it is"


class NoClock(StrEnum):
    """Why a clock was not corrected: a result, nothing moves in an empty room."""

    SWITCHED_OFF = "clocks are not to be estimated"
    FEW_PICTURES = "too few pictures"
    NO_MOTION = "nothing that moves tells the cameras' times apart"
    UNSURE = "what moves tells the cameras' times too vaguely"


@dataclass(frozen=True, slots=True)
class CameraClock:
    """clock: as used; sigma_s, drift_sigma: standard errors, None where it was kept; lags: measured with this camera;
    doubt: why it was kept, None where it was not."""

    camera: str
    clock: Clock
    source: ClockSource
    sigma_s: float | None
    drift_sigma: float | None
    lags: int
    doubt: NoClock | None


@dataclass(frozen=True, slots=True, eq=False)
class Clocks:
    """One a camera, the reference first; residual_s: root mean square of the lags about the clocks, None without lags;
    pictures_read: what the estimate cost."""

    cameras: tuple[CameraClock, ...]
    residual_s: float | None
    pictures_read: int

    @property
    def clocks(self) -> tuple[Clock, ...]:
        """The clocks to use."""
        return tuple(camera.clock for camera in self.cameras)


def estimate_clocks(footage: Footage, levels: Sequence[Level | None], config: ClockConfig) -> Clocks:
    """Every camera's clock against the first camera's.

    levels: one a camera, see ``motion_signal``; cameras with a pose may give it by the world's Y, others by the floor.
    A clock of which the motion says too little is kept as it is, and its ``doubt`` says why; nothing is ever guessed.
    """
    count = len(footage.cameras)
    if count == 1 or not config.estimate:
        return _kept(footage, NoClock.SWITCHED_OFF)
    if min(len(times_s) for times_s in footage.times_s) < 8:  # what a window needs at 4 Hz
        return _kept(footage, NoClock.FEW_PICTURES)
    reading = _Reading(footage)
    span_s = (float(footage.times_s[0][0]), float(footage.times_s[0][-1]))
    busy = busiest_times(footage, 0, span_s, config.windows, config.places)
    reading.pictures += 2 * config.places * config.windows
    rough = _rough_clocks(reading, levels, sorted(busy, key=lambda place: -place[1])[: config.blocks], config)
    lags = _fine_lags(reading, rough, [time_s for time_s, _ in busy], config)
    fit = fit_clocks(lags, count, config.drift_sigma, config.outlier_gate) if lags else None
    cameras = tuple(_camera_clock(index, footage, rough[index], fit, span_s, config) for index in range(count))
    return Clocks(cameras, fit.residual_s if fit is not None else None, reading.pictures)


@dataclass(slots=True, eq=False)
class _Reading:
    """Footage that counts what is read of it."""

    footage: Footage
    pictures: int = 0

    def between(self, camera: int, begin_s: float, end_s: float) -> list[tuple[float, np.ndarray]]:
        def tick(count: int) -> None:
            self.pictures += count

        return pictures_between(self.footage, camera, begin_s, end_s, tick)


@dataclass(frozen=True, slots=True)
class _Rough:
    """lag_s: the camera's clock less the reference's, at about at_s."""

    lag_s: float
    at_s: float


def _kept(footage: Footage, doubt: NoClock) -> Clocks:
    kept = [
        CameraClock(camera.name, Clock(), ClockSource.KEPT, None, None, 0, doubt) for camera in footage.cameras[1:]
    ]
    first = CameraClock(footage.cameras[0].name, Clock(), ClockSource.REFERENCE, 0.0, 0.0, 0, None)
    return Clocks((first, *kept), None, 0)


def pose_level(camera: Camera) -> Level | None:
    """Heights by a known pose: the world's Y; None where the pose is unknown."""
    if camera.T_world_camera is None:
        return None
    return Level(camera.T_world_camera[1, :3], float(camera.T_world_camera[1, 3]))


def _rough_clocks(
    reading: _Reading, levels: Sequence[Level | None], places: Sequence[tuple[float, float]], config: ClockConfig
) -> list[_Rough | None]:
    """The lag of each camera from signals; None where no block of the recording tells it."""
    same = [level if all(other is not None for other in levels) else None for level in levels]
    rough: list[_Rough | None] = [_Rough(0.0, 0.0), *[None] * (len(levels) - 1)]
    for at_s, _ in places:
        if all(found is not None for found in rough):
            break
        signals = [_block(reading, 0, at_s, config.block_s / 2, same[0], config)]
        for camera in range(1, len(levels)):
            best = None if rough[camera] else _best_lag(reading, camera, at_s, signals[0], same[camera], config)
            if best is not None and best.clear(config.signal):
                rough[camera] = _Rough(best.lag_s, at_s)
    return rough


def _best_lag(
    reading: _Reading, camera: int, at_s: float, reference: MotionSignal, level: Level | None, config: ClockConfig
) -> SignalLag | None:
    """The clearest lag about each guess: clocks of one epoch, and recorders started together."""
    best = None
    for around_s, reach_s in _guesses(reading.footage.times_s[0], reading.footage.times_s[camera], config):
        signal = _block(reading, camera, at_s + around_s, config.block_s / 2 + reach_s, level, config)
        found = signal_lag(reference, signal, around_s, reach_s, config.signal)
        if found is not None and (best is None or found.peak > best.peak):
            best = found
        if best is not None and best.clear(config.signal):
            break
    return best


def _guesses(reference_s: np.ndarray, other_s: np.ndarray, config: ClockConfig) -> list[tuple[float, float]]:
    """(lag, reach) to search about."""
    common_s = min(reference_s[-1], other_s[-1]) - max(reference_s[0], other_s[0])
    together = (float(other_s[0] - reference_s[0]), config.most_late_s)
    half_s = 0.5 * min(np.ptp(reference_s), np.ptp(other_s))
    return [(0.0, config.most_ahead_s), together] if common_s > half_s - config.most_ahead_s else [together]


def _block(
    reading: _Reading, camera: int, at_s: float, half_s: float, level: Level | None, config: ClockConfig
) -> MotionSignal:
    pictures = reading.between(camera, at_s - half_s, at_s + half_s)
    if len(pictures) < 3:
        return MotionSignal(np.empty(0), np.empty((0, 1)))
    noise = noise_per_m([pictures[0][1], pictures[-1][1]])
    return motion_signal(pictures, reading.footage.cameras[camera], level, noise, config.signal)


def _fine_lags(
    reading: _Reading, rough: Sequence[_Rough | None], times_s: Sequence[float], config: ClockConfig
) -> list[PairLag]:
    """The lags of all pairs of posed cameras in every window."""
    lags = []
    for at_s in times_s:
        clips = [_clip(reading, camera, at_s, found, config) for camera, found in enumerate(rough)]
        for first, second in combinations(range(len(rough)), 2):
            one, other = clips[first], clips[second]
            a, b = rough[first], rough[second]
            if one is None or other is None or a is None or b is None:
                continue
            far_s = max(abs(at_s - found.at_s) for found in (a, b) if found is not rough[0])
            reach_s = config.reach_s + 2.0 * config.drift_sigma * far_s
            found = surface_lag(one, other, b.lag_s - a.lag_s, reach_s, config.surface)
            if found is not None:
                sigma_s = float(np.hypot(found.sigma_s, config.systematic_s))
                lags.append(PairLag(first, second, at_s, found.lag_s, sigma_s))
    return lags


def _clip(reading: _Reading, camera: int, at_s: float, rough: _Rough | None, config: ClockConfig) -> Clip | None:
    """The window's pictures of a camera, with room for its clock to be off; None where it has too few or no pose."""
    if rough is None or reading.footage.cameras[camera].T_world_camera is None:
        return None
    half_s = config.window_s / 2 + (0.0 if camera == 0 else 2.0 * config.reach_s)
    pictures = reading.between(camera, at_s + rough.lag_s - half_s, at_s + rough.lag_s + half_s)
    return make_clip(reading.footage.cameras[camera], pictures, config.surface) if len(pictures) >= 8 else None


def _camera_clock(
    index: int, footage: Footage, rough: _Rough | None, fit: ClockFit | None, span_s: tuple[float, float],
    config: ClockConfig,
) -> CameraClock:  # fmt: skip
    name = footage.cameras[index].name
    if index == 0:
        return CameraClock(name, Clock(), ClockSource.REFERENCE, 0.0, 0.0, 0, None)
    lags = sum(index in (lag.first, lag.second) for lag in fit.used) if fit is not None else 0
    if fit is not None and np.isfinite(fit.ahead_s[index]):
        sigma_s = max(fit.sigma_s(index, time_s) for time_s in span_s)
        if sigma_s <= config.worst_sigma_s:
            clock = Clock(ahead_s=float(fit.ahead_s[index]), drift=float(fit.drift[index]), at_s=fit.at_s)
            drift_sigma = float(np.sqrt(fit.covariance[index, 1, 1]))
            return CameraClock(name, clock, ClockSource.SURFACES, fit.sigma_s(index, fit.at_s), drift_sigma, lags, None)
    if rough is None:
        return CameraClock(name, Clock(), ClockSource.KEPT, None, None, lags, NoClock.NO_MOTION)
    if abs(rough.lag_s) < 3.0 * config.signal_sigma_s:  # nothing speaks against its stamps
        return CameraClock(name, Clock(), ClockSource.KEPT, None, None, lags, NoClock.UNSURE)
    clock = Clock(ahead_s=rough.lag_s, at_s=rough.at_s)
    return CameraClock(name, clock, ClockSource.SIGNALS, config.signal_sigma_s, None, lags, None)
