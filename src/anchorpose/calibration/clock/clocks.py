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
from typing import Final

import numpy as np

from anchorpose.calibration.clock.motion_signal import (
    Level,
    MotionSignal,
    SignalConfig,
    SignalLag,
    motion_signal,
    signal_lags,
)
from anchorpose.calibration.clock.offset_fit import ClockFit, PairLag, busiest_times, fit_clocks, pictures_between
from anchorpose.calibration.clock.surface_lag import Clip, SurfaceLagConfig, make_clip, surface_lag
from anchorpose.calibration.noise import noise_per_m
from anchorpose.camera import Camera
from anchorpose.recording.depth_image import Footage
from anchorpose.recording.recording import Clock

PICTURES_KEPT: Final = 300  # 260 MB of a Kinect v2's


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockConfig:
    """How the clocks of several cameras are compared."""

    estimate: bool = True  # False: the stamps are believed as they are
    most_ahead_s: float = 5.0  # how far clocks of one epoch may be apart
    most_late_s: float = 15.0  # between the starts of two recorders whose clocks have nothing in common
    block_s: float = 12.0  # of pictures for the first step: several movements
    blocks: int = 3  # tried for the first step, the busiest first
    window_s: float = 2.0  # of pictures for the second step
    windows: int = 10  # over the whole recording: a drift shows between its ends, and some windows tell little
    places: int = 4  # looked at in each tenth of the recording, to find where much moves
    reach_s: float = 0.12  # twice what the first step was ever off
    drift_sigma: float = 1e-4  # a quartz is good to 100 parts in a million
    signal_sigma_s: float = 0.03  # of the first step's lags on simulated clinics
    systematic_s: float = 0.001  # of a window, whatever its residuals say: 1 mm of the sensor at 1 m/s
    outlier_gate: float = 5.0  # deviations
    least_windows: int = 2  # that must agree where the first step is not sure by itself
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
    windows = int(np.clip((span_s[1] - span_s[0]) / config.window_s, 1, config.windows))
    busy = busiest_times(reading, 0, span_s, windows, config.places)
    rough = _rough_clocks(reading, levels, [at_s for at_s, _ in sorted(busy, key=lambda place: -place[1])], config)
    lags = _fine_lags(reading, rough, [time_s for time_s, _ in busy], config)
    fit = fit_clocks(lags, count, config.drift_sigma, config.outlier_gate) if lags else None
    cameras = tuple(_camera_clock(index, footage, rough, fit, span_s, config) for index in range(count))
    return Clocks(cameras, fit.residual_s if fit is not None else None, reading.pictures)


@dataclass(slots=True, eq=False)
class _Reading:
    """Footage that counts what is read of it and keeps the last pictures: windows of a short recording overlap."""

    footage: Footage
    pictures: int = 0
    kept: dict[tuple[int, int], np.ndarray | None] = field(default_factory=dict)

    @property
    def cameras(self) -> tuple[Camera, ...]:
        return self.footage.cameras

    @property
    def times_s(self) -> tuple[np.ndarray, ...]:
        return self.footage.times_s

    def read(self, camera: int, position: int) -> np.ndarray | None:
        """(height, width) float32 metres, or None."""
        if (camera, position) not in self.kept:
            self.pictures += 1
            if len(self.kept) >= PICTURES_KEPT:
                del self.kept[next(iter(self.kept))]
            self.kept[camera, position] = self.footage.read(camera, position)
        return self.kept[camera, position]


@dataclass(frozen=True, slots=True)
class _Rough:
    """lag_s: the camera's clock less the reference's, at about at_s; reach_s: how far off; sure: as it stands."""

    lag_s: float
    at_s: float
    reach_s: float
    sure: bool


def _kept(footage: Footage, doubt: NoClock) -> Clocks:
    kept = [CameraClock(camera.name, Clock(), ClockSource.KEPT, None, None, 0, doubt) for camera in footage.cameras[1:]]
    first = CameraClock(footage.cameras[0].name, Clock(), ClockSource.REFERENCE, 0.0, 0.0, 0, None)
    return Clocks((first, *kept), None, 0)


def pose_level(camera: Camera) -> Level | None:
    """Heights by a known pose: the world's Y; None where the pose is unknown."""
    if camera.T_world_camera is None:
        return None
    return Level(camera.T_world_camera[1, :3], float(camera.T_world_camera[1, 3]))


def _rough_clocks(
    reading: _Reading, levels: Sequence[Level | None], busiest_s: Sequence[float], config: ClockConfig
) -> list[_Rough | None]:
    """The lag of each camera from signals; where they are not sure, the surfaces choose among their best lags and what
    the stamps say. None where neither tells it."""
    same = [level if all(other is not None for other in levels) else None for level in levels]
    rough: list[_Rough | None] = [_Rough(0.0, 0.0, 0.0, True), *[None] * (len(levels) - 1)]
    possible: list[list[_Rough]] = [_from_stamps(reading, camera, config) for camera in range(len(levels))]
    for at_s in _blocks(reading.times_s[0], busiest_s, config):
        reference = _block(reading, 0, at_s, config.block_s / 2, same[0], config)
        for camera in (camera for camera, found in enumerate(rough) if found is None):
            lags = _best_lags(reading, camera, at_s, reference, same[camera], config)
            found = [_Rough(lag.lag_s, at_s, config.reach_s, lag.sure(config.signal)) for lag in lags]
            rough[camera] = found[0] if found and found[0].sure else None
            possible[camera] += found
    times_s = busiest_s[: config.least_windows]
    for camera in (camera for camera, found in enumerate(rough) if found is None):
        rough[camera] = _best_by_surfaces(reading, camera, possible[camera], times_s, config)
    return rough


def _blocks(times_s: np.ndarray, busiest_s: Sequence[float], config: ClockConfig) -> list[float]:
    """Middles of the blocks for the first step: the busiest, none reaching beyond the recording, all different."""
    low, high = times_s[0] + config.block_s / 2, times_s[-1] - config.block_s / 2
    if low >= high:
        return [float(times_s[0] + times_s[-1]) / 2]
    inside = [float(np.clip(at_s, low, high)) for at_s in busiest_s]
    apart = [
        at_s for k, at_s in enumerate(inside) if all(abs(at_s - other) > config.block_s / 2 for other in inside[:k])
    ]
    return apart[: config.blocks]


def _from_stamps(footage: Footage, camera: int, config: ClockConfig) -> list[_Rough]:
    """Clocks that agree, where they are of one epoch."""
    around_s, _ = _guesses(footage.times_s[0], footage.times_s[camera], config)[0]
    at_s = float(footage.times_s[0][len(footage.times_s[0]) // 2])
    return [_Rough(0.0, at_s, config.reach_s, False)] if around_s == 0.0 else []


def _best_by_surfaces(
    reading: _Reading, camera: int, possible: Sequence[_Rough], times_s: Sequence[float], config: ClockConfig
) -> _Rough | None:
    """The lag at which this camera's surfaces fit the reference camera's best; None where no lag can be looked at."""
    best, least_m = None, np.inf
    reference = _Rough(0.0, 0.0, config.reach_s, True)
    clips = [_clip(reading, 0, at_s, reference, config) for at_s in times_s]
    for rough in possible:
        misfits = []
        for at_s, first in zip(times_s, clips, strict=True):
            other = _clip(reading, camera, at_s, rough, config)
            if first is not None and other is not None:
                found = surface_lag(first, other, rough.lag_s, rough.reach_s, config.surface)
                misfits += [] if found is None else [found.misfit_m]
        if misfits and np.mean(misfits) < least_m:
            best, least_m = rough, float(np.mean(misfits))
    return best


def _best_lags(
    reading: _Reading, camera: int, at_s: float, reference: MotionSignal, level: Level | None, config: ClockConfig
) -> list[SignalLag]:
    """The lags about each guess, the best first: clocks of one epoch, or recorders started together."""
    found: list[SignalLag] = []
    for around_s, reach_s in _guesses(reading.times_s[0], reading.times_s[camera], config):
        signal = _block(reading, camera, at_s + around_s, config.block_s / 2 + reach_s, level, config)
        found += signal_lags(reference, signal, around_s, reach_s, config.signal)
        if found and found[0].sure(config.signal):
            break
    return sorted(found, key=lambda lag: -lag.peak)


def _guesses(reference_s: np.ndarray, other_s: np.ndarray, config: ClockConfig) -> list[tuple[float, float]]:
    """(lag, reach) to search about."""
    common_s = min(reference_s[-1], other_s[-1]) - max(reference_s[0], other_s[0])
    together = (float(other_s[0] - reference_s[0]), config.most_late_s)
    half_s = 0.5 * min(np.ptp(reference_s), np.ptp(other_s))
    return [(0.0, config.most_ahead_s), together] if common_s > half_s - config.most_ahead_s else [together]


def _block(
    reading: _Reading, camera: int, at_s: float, half_s: float, level: Level | None, config: ClockConfig
) -> MotionSignal:
    pictures = pictures_between(reading, camera, at_s - half_s, at_s + half_s)
    if len(pictures) < 3:
        return MotionSignal(np.empty(0), np.empty((0, 1)))
    noise = noise_per_m([pictures[0][1], pictures[-1][1]])
    return motion_signal(pictures, reading.cameras[camera], level, noise, config.signal)


def _fine_lags(
    reading: _Reading, rough: Sequence[_Rough | None], times_s: Sequence[float], config: ClockConfig
) -> list[PairLag]:
    """The lags of all pairs of posed cameras in every window, less the rough ones: times may count from 1970."""
    lags = []
    for at_s in times_s:
        clips = [_clip(reading, camera, at_s, found, config) for camera, found in enumerate(rough)]
        for first, second in combinations(range(len(rough)), 2):
            one, other = clips[first], clips[second]
            a, b = rough[first], rough[second]
            if one is None or other is None or a is None or b is None:
                continue
            far_s = max(abs(at_s - found.at_s) for found in (a, b) if found is not rough[0])
            reach_s = max(a.reach_s, b.reach_s) + 2.0 * config.drift_sigma * far_s
            lag = surface_lag(one, other, b.lag_s - a.lag_s, reach_s, config.surface)
            if lag is not None:
                sigma_s = float(np.hypot(lag.sigma_s, config.systematic_s))
                lags.append(PairLag(first, second, at_s, lag.lag_s - (b.lag_s - a.lag_s), sigma_s))
    return lags


def _clip(reading: _Reading, camera: int, at_s: float, rough: _Rough | None, config: ClockConfig) -> Clip | None:
    """The window's pictures of a camera, with room for its clock to be off; None where it has too few or no pose."""
    if rough is None or reading.cameras[camera].T_world_camera is None:
        return None
    half_s = config.window_s / 2 + rough.reach_s
    pictures = pictures_between(reading, camera, at_s + rough.lag_s - half_s, at_s + rough.lag_s + half_s)
    return make_clip(reading.cameras[camera], pictures, config.surface) if len(pictures) >= 8 else None


def _camera_clock(
    index: int, footage: Footage, roughs: Sequence[_Rough | None], fit: ClockFit | None, span_s: tuple[float, float],
    config: ClockConfig,
) -> CameraClock:  # fmt: skip
    name, rough = footage.cameras[index].name, roughs[index]
    if index == 0:
        return CameraClock(name, Clock(), ClockSource.REFERENCE, 0.0, 0.0, 0, None)
    lags = sum(index in (lag.first, lag.second) for lag in fit.used) if fit is not None else 0
    if fit is not None and rough is not None and np.isfinite(fit.ahead_s[index]):
        sigma_s = max(fit.sigma_s(index, time_s) for time_s in span_s)
        windows = len({lag.at_s for lag in fit.used if index in (lag.first, lag.second)})
        if sigma_s <= config.worst_sigma_s and (rough.sure or windows >= config.least_windows):
            clock = Clock(ahead_s=rough.lag_s + float(fit.ahead_s[index]), drift=float(fit.drift[index]), at_s=fit.at_s)
            drift_sigma = float(np.sqrt(fit.covariance[index, 1, 1]))
            return CameraClock(name, clock, ClockSource.SURFACES, fit.sigma_s(index, fit.at_s), drift_sigma, lags, None)
    if rough is None or not rough.sure:
        doubt = NoClock.UNSURE if lags or rough is not None else NoClock.NO_MOTION
        return CameraClock(name, Clock(), ClockSource.KEPT, None, None, lags, doubt)
    if abs(rough.lag_s) < 3.0 * config.signal_sigma_s:  # nothing speaks against its stamps
        return CameraClock(name, Clock(), ClockSource.KEPT, None, None, lags, NoClock.UNSURE)
    clock = Clock(ahead_s=rough.lag_s, at_s=rough.at_s)
    return CameraClock(name, clock, ClockSource.SIGNALS, config.signal_sigma_s, None, lags, None)
