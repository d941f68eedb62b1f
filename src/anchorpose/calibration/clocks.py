"""Find the clocks of all cameras from the movement in front of them.

First, the amount of movement at each height (``clock_lags``) gives the lags between the clocks, which may be several
seconds. These lags have an error of about a twentieth of a second; this step needs no poses. If the poses are known,
the surfaces that two cameras both see (``clock_surfaces``) then give the lag between their clocks to a millisecond.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from scipy.sparse.csgraph import connected_components

from anchorpose.calibration.clock_lags import (
    DRIFT_SIGMA,
    LEAST_FRAMES,
    LEAST_WINDOWS,
    REACH_S,
    WINDOW_S,
    PairLag,
    RoughLag,
    busiest_times,
    fine_lags,
    rough_lags,
    stamped_lags,
)
from anchorpose.calibration.first_frames import FloorPlane, floor_of_room, level_of_pose
from anchorpose.camera import Camera
from anchorpose.recording.depth_image import RecordedFrames
from anchorpose.recording.recording import Clock, Recording, align_clocks
from anchorpose.settings import settings

ROUNDS: Final = 20  # maximum number of wrong lags removed from the fit, one per round; no recording had more wrong lags
OUTLIER_GATE: Final = 5.0  # standard deviations; a lag that deviates more from the fitted clocks is removed


@dataclass(frozen=True, slots=True, eq=False)
class ClockFit:
    """The fitted clocks. ahead_s, drift (cameras,): how far each clock is ahead of the first camera's clock at the time
    at_s, and the clock's drift; NaN if no lag links the camera to the first camera; covariance (cameras, 2, 2) of these
    two values; used: the lags that were not removed; residual_s: root mean square of the residuals of these lags.
    """

    at_s: float
    ahead_s: np.ndarray
    drift: np.ndarray
    covariance: np.ndarray
    used: tuple[PairLag, ...]
    residual_s: float

    def sigma_s(self, camera: int, time_s: float) -> float:
        """Return the standard error of a camera's clock at a time of the reference clock (the first camera's clock)."""
        row = np.array([1.0, time_s - self.at_s])
        return float(np.sqrt(row @ self.covariance[camera] @ row))


def fit_clocks(lags: Sequence[PairLag], cameras: int) -> ClockFit:
    """Fit all clocks at once by weighted least squares, each drift with a prior of 0 ± ``DRIFT_SIGMA``.

    The lag that deviates most from the fitted clocks is removed, and the fit repeated, as long as this lag deviates by
    more than ``OUTLIER_GATE`` standard deviations and more than ``OUTLIER_GATE`` times the median deviation, and more
    than two lags remain. The standard errors increase with the scatter of the remaining lags. Raises ValueError without
    lags.
    """
    if not lags:
        raise ValueError("clocks need at least one lag")
    kept = list(lags)
    at_s = float(np.average([lag.at_s for lag in lags], weights=[lag.sigma_s**-2 for lag in lags]))
    for _ in range(ROUNDS):
        values, covariance = _solve(kept, cameras, at_s)
        off = np.array([_row(lag, cameras, at_s) @ values - lag.lag_s for lag in kept])
        deviations = np.abs(off) / [lag.sigma_s for lag in kept]
        if len(kept) <= 2 or deviations.max() <= OUTLIER_GATE * max(1.0, float(np.median(deviations))):
            break
        del kept[int(deviations.argmax())]
    known = 2 * len({camera for lag in kept for camera in (lag.first, lag.second)} - {0})
    excess = max(1.0, float((deviations**2).sum()) / max(1, len(kept) - known // 2))
    reached = _reached(kept, cameras)
    values = np.where(np.repeat(reached, 2), values, np.nan).reshape(cameras, 2)
    blocks = np.array([covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(cameras)]) * excess
    return ClockFit(at_s, values[:, 0], values[:, 1], blocks, tuple(kept), float(np.sqrt(np.mean(off**2))))


def _row(lag: PairLag, cameras: int, at_s: float) -> np.ndarray:
    """Return the least-squares row of one lag, (2 * cameras,): the derivatives of the lag by the offset (ahead) and the
    drift of each clock, one clock after the other; 0 for the first camera.
    """
    row = np.zeros(2 * cameras)
    row[2 * lag.second : 2 * lag.second + 2] = 1.0, lag.at_s - at_s
    row[2 * lag.first : 2 * lag.first + 2] = -1.0, at_s - lag.at_s
    row[:2] = 0.0
    return row


def _solve(lags: Sequence[PairLag], cameras: int, at_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (ahead, drift) of one clock after the other (2 * cameras,), and the covariance of these values."""
    rows = np.array([_row(lag, cameras, at_s) for lag in lags])
    weight = np.array([lag.sigma_s**-2 for lag in lags])
    information = (rows * weight[:, None]).T @ rows
    information[np.arange(1, 2 * cameras, 2), np.arange(1, 2 * cameras, 2)] += DRIFT_SIGMA**-2
    ahead = np.arange(0, 2 * cameras, 2)
    information[ahead, ahead] += 1e-12 * (weight.max() + 1.0)  # keeps the matrix invertible if a camera has no lag
    covariance = np.linalg.inv(information)
    covariance[:2] = covariance[:, :2] = 0.0
    return covariance @ (rows.T @ (weight * [lag.lag_s for lag in lags])), covariance


def _reached(lags: Sequence[PairLag], cameras: int) -> np.ndarray:
    """Return (cameras,) bool: cameras linked to the first by lags, directly or through other cameras."""
    linked = np.zeros((cameras, cameras))
    linked[[lag.first for lag in lags], [lag.second for lag in lags]] = 1
    group: np.ndarray = connected_components(linked, directed=False)[1]
    return group == group[0]


# maximum number of windows (short parts of the recording in which lags are measured). The windows are spread over the
# whole recording, since the drift of a clock shows in the difference between the lags at the recording's beginning and
# at its end
WINDOWS: Final = 10
SPREAD: Final = 3  # every third window is compared first, so that the windows compared first already span the recording
# number of windows compared first; the lags in these windows show whether the time stamps are correct to a tenth of a
# second
CONFIRMING: Final = 4
# minimum share, used twice: in at least this share of the compared windows, every camera must have a lag that is not an
# outlier; and at least this share of all lags must not be outliers
AGREEING: Final = 0.75
# s, maximum rms residual of lags that count as agreeing; a sixth of the time between two frames at 15 Hz
APART_S: Final = 0.01
# s; if all clocks' sigmas are below this, no more windows are compared: a limb at 0.5 m/s moves 1 mm in 2 ms
ENOUGH_S: Final = 0.002
SIGNAL_SIGMA_S: Final = 0.03  # s, standard deviation of the errors of lags from signals of motion, on simulated clinics
# s, maximum accepted sigma of a clock at both ends of the recording. At 30 Hz, frames of two cameras that are paired by
# time lie up to 16 ms apart; the limit of sigma is half of this time
WORST_SIGMA_S: Final = 0.008
# number of frames whose median replaces a missing image of the empty room; the median shows few people
FLOOR_FRAMES: Final = 9


@settings
class ClockConfig:
    """Settings for comparing the clocks of several cameras."""

    estimate: bool = True  # whether clocks are estimated; False = the time stamps are used unchanged


class ClockSource(StrEnum):
    """The source of a camera's clock, which people read in the run's notes."""

    REFERENCE = "the reference"
    RESULTS = "that of the corrected results"
    SURFACES = "from the surfaces it shares with other cameras"
    SIGNALS = "from how much moves at each height, to a twentieth of a second"
    KEPT = "kept as it is"


class NoClock(StrEnum):
    """The reason why a clock was not corrected. Such a reason is a result and not an error: in an empty room, nothing
    moves.
    """

    SWITCHED_OFF = "clocks are not to be estimated"
    FEW_FRAMES = "too few depth frames"
    NO_MOTION = "nothing that moves shows the lag between the cameras"
    UNSURE = "the movements show the lag between the cameras too vaguely"


@dataclass(frozen=True, slots=True)
class CameraClock:
    """A camera's clock. clock: the clock to use; sigma_s, drift_sigma: standard errors of offset and drift, None if the
    clock was kept as recorded; lags: number of lags measured with this camera; doubt: why the clock was kept, None if
    it was corrected.
    """

    camera: str
    clock: Clock
    source: ClockSource
    sigma_s: float | None = None
    drift_sigma: float | None = None
    lags: int = 0
    doubt: NoClock | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Clocks:
    """All cameras' clocks, the reference camera's first; residual_s: root-mean-square difference between the measured
    lags and the lags that follow from these clocks, None without lags.
    """

    cameras: tuple[CameraClock, ...]
    residual_s: float | None

    @property
    def clocks(self) -> tuple[Clock, ...]:
        """Return the clock to use for each camera."""
        return tuple(camera.clock for camera in self.cameras)


def settle_clocks(recording: Recording, cameras: Sequence[Camera], config: ClockConfig) -> tuple[Recording, Clocks]:
    """Return ``recording`` with all times converted to the first camera's clock. The given ``recording`` must have its
    original time stamps.

    cameras: as in the recording, with the poses known so far. With poses the clocks are more accurate, so call this
    function before and again after poses are found. A clock that cannot be estimated stays unchanged.
    """
    frames = RecordedFrames(recording, tuple(cameras))
    wanted = config.estimate and len(cameras) > 1
    levels = [_level(frames, index) if wanted else None for index in range(len(cameras))]
    clocks = estimate_clocks(frames, levels, config)
    return align_clocks(recording, clocks.clocks), clocks


def clocks_of_results(cameras: Sequence[Camera], known: Mapping[str, Clock]) -> Clocks:
    """Return the clocks that an earlier run of this recording found; known: these clocks by camera name."""
    others = (CameraClock(camera.name, known[camera.name], ClockSource.RESULTS) for camera in cameras[1:])
    return Clocks((_reference(cameras), *others), None)


def _level(frames: RecordedFrames, index: int) -> FloorPlane | None:
    """Return the plane Y = 0 of the world if the camera has a pose, else the floor that it sees, else None."""
    camera, recording = frames.cameras[index], frames.recording
    if camera.T_world_camera is not None:
        return level_of_pose(camera.T_world_camera)
    room = recording.backgrounds_m[index]
    if room is None:
        positions = np.linspace(0, len(frames.times_s[index]) - 1, FLOOR_FRAMES).astype(int)
        seen = [depth for k in np.unique(positions) if (depth := frames.read(index, int(k))) is not None]
        if not seen:
            return None
        room = np.median(np.stack(seen), axis=0).astype(np.float32)
    plane = floor_of_room(camera, room, ())
    return plane if isinstance(plane, FloorPlane) else None


def estimate_clocks(frames: RecordedFrames, levels: Sequence[FloorPlane | None], config: ClockConfig) -> Clocks:
    """Estimate the offset and drift of every camera's clock against the first camera's clock.

    levels: one per camera, as ``motion_signal`` needs it: the plane Y = 0 of the world for cameras with a pose, the
    floor for other cameras. If the motion does not suffice to estimate a clock, the clock is kept, and its ``doubt``
    states why.
    """
    count = len(frames.cameras)
    if count == 1 or not config.estimate:
        return _kept(frames.cameras, NoClock.SWITCHED_OFF)
    if min(len(times_s) for times_s in frames.times_s) < LEAST_FRAMES:
        return _kept(frames.cameras, NoClock.FEW_FRAMES)
    span_s = (float(frames.times_s[0][0]), float(frames.times_s[0][-1]))
    windows = int(np.clip((span_s[1] - span_s[0]) / WINDOW_S, 1, WINDOWS))
    busy = busiest_times(frames, span_s, windows)
    times_s = [time_s for first in range(SPREAD) for time_s, _ in busy[first::SPREAD]]
    rough, lags = stamped_lags(frames), list[PairLag]()
    first_s = times_s[:CONFIRMING]
    if None not in rough:
        lags = fine_lags(frames, rough, first_s)
    # if the lags are not confirmed, either the time stamps are from different clocks, or the cameras see too little
    # movement in common
    if not _is_confirmed(lags, count, len(first_s)):
        by_signals = rough_lags(frames, levels, [at_s for at_s, _ in sorted(busy, key=lambda place: -place[1])])
        others = fine_lags(frames, by_signals, first_s)
        # the signals of a repeated movement also correlate at wrong lags, but the surfaces agree only at the correct
        # lag
        if _agreeing(others, count) >= _agreeing(lags, count):
            rough, lags = by_signals, others
    fit = _fit(frames, rough, lags, times_s[CONFIRMING:], span_s)
    corrected = (_camera_clock(k, frames.cameras[k].name, rough[k], fit, span_s) for k in range(1, count))
    return Clocks((_reference(frames.cameras), *corrected), fit.residual_s if fit is not None else None)


def _is_confirmed(lags: Sequence[PairLag], count: int, tried: int) -> bool:
    """Return whether the lags that were measured in the first windows (short parts of the recording) confirm the rough
    lags; if the rough lags are wrong, the lags of different windows scatter.

    tried: number of windows in which lags were searched: ``CONFIRMING``, or fewer in a short recording.
    """
    if not _agreeing(lags, count):
        return False
    used = fit_clocks(lags, count).used
    windows = [len({lag.at_s for lag in used if camera in (lag.first, lag.second)}) for camera in range(count)]
    return min(windows) >= max(LEAST_WINDOWS, AGREEING * tried)


def _agreeing(lags: Sequence[PairLag], count: int) -> int:
    """Return how many lags agree with the clocks fitted to all lags. Return 0 if the lags scatter, leave a camera
    without a clock, or lie near the end of the range in which they were searched.
    """
    fit = fit_clocks(lags, count) if lags else None
    near = fit is not None and _agree(fit, lags) and bool((np.abs(fit.ahead_s) < REACH_S / 2).all())
    return len(fit.used) if fit is not None and near else 0


def _agree(fit: ClockFit, lags: Sequence[PairLag]) -> bool:
    """Return whether nearly all lags agree with the fitted clocks, and the clocks of all cameras are known."""
    known = bool(np.isfinite(fit.ahead_s).all())
    return known and len(fit.used) >= AGREEING * len(lags) and fit.residual_s <= APART_S


def _fit(
    frames: RecordedFrames,
    rough: Sequence[RoughLag | None],
    lags: Sequence[PairLag],
    left_s: Sequence[float],
    span_s: tuple[float, float],
) -> ClockFit | None:
    """Fit the clocks to the lags that were measured in the first windows (short parts of the recording); then measure
    lags in further windows, until the lags agree with the fitted clocks and all clocks' sigmas are below ``ENOUGH_S``,
    or no window is left. Return None without lags.
    """
    fit = fit_clocks(lags, len(rough)) if lags else None
    for at_s in left_s:
        if fit is not None and _agree(fit, lags):
            sigmas_s = [fit.sigma_s(camera, time_s) for camera in range(1, len(rough)) for time_s in span_s]
            if max(sigmas_s) < ENOUGH_S:
                break
        lags = [*lags, *fine_lags(frames, rough, [at_s])]
        fit = fit_clocks(lags, len(rough)) if lags else None
    return fit


def _kept(cameras: Sequence[Camera], doubt: NoClock) -> Clocks:
    kept = [CameraClock(camera.name, Clock(), ClockSource.KEPT, doubt=doubt) for camera in cameras[1:]]
    return Clocks((_reference(cameras), *kept), None)


def _reference(cameras: Sequence[Camera]) -> CameraClock:
    return CameraClock(cameras[0].name, Clock(), ClockSource.REFERENCE, 0.0, 0.0)


def _camera_clock(
    index: int, name: str, rough: RoughLag | None, fit: ClockFit | None, span_s: tuple[float, float]
) -> CameraClock:
    """Return the fitted clock if it is accurate. Otherwise return the clock shifted by the rough lag, if this lag is
    certain, else the recorded clock.
    """
    lags = sum(index in (lag.first, lag.second) for lag in fit.used) if fit is not None else 0
    if fit is not None and rough is not None and np.isfinite(fit.ahead_s[index]):
        sigma_s = max(fit.sigma_s(index, time_s) for time_s in span_s)
        windows = len({lag.at_s for lag in fit.used if index in (lag.first, lag.second)})
        if sigma_s <= WORST_SIGMA_S and (rough.certain or windows >= LEAST_WINDOWS):
            clock = Clock(ahead_s=rough.lag_s + float(fit.ahead_s[index]), drift=float(fit.drift[index]), at_s=fit.at_s)
            drift_sigma = float(np.sqrt(fit.covariance[index, 1, 1]))
            return CameraClock(name, clock, ClockSource.SURFACES, fit.sigma_s(index, fit.at_s), drift_sigma, lags)
    if rough is None or not rough.certain:
        doubt = NoClock.UNSURE if lags or rough is not None else NoClock.NO_MOTION
        return CameraClock(name, Clock(), ClockSource.KEPT, lags=lags, doubt=doubt)
    if abs(rough.lag_s) < 3.0 * SIGNAL_SIGMA_S:  # the lag is 0 within its error, so nothing contradicts the time stamps
        return CameraClock(name, Clock(), ClockSource.KEPT, lags=lags, doubt=NoClock.UNSURE)
    clock = Clock(ahead_s=rough.lag_s, at_s=rough.at_s)
    return CameraClock(name, clock, ClockSource.SIGNALS, SIGNAL_SIGMA_S, None, lags)


def clock_notes(clocks: Clocks) -> tuple[str, ...]:
    """Return one sentence per camera except the first; no sentences if clocks were not to be estimated."""
    first = clocks.cameras[0].camera
    return tuple(_sentence(found, first) for found in clocks.cameras[1:] if found.doubt is not NoClock.SWITCHED_OFF)


def _sentence(found: CameraClock, first: str) -> str:
    if found.doubt is not None:
        return f"the clock of camera {found.camera} was used as it is: {found.doubt.value}"
    if found.source is ClockSource.RESULTS:
        used = "was used as it is, as in" if found.clock == Clock() else "was corrected as in"
        return f"the clock of camera {found.camera} {used} the corrected results"
    ahead = f"{abs(found.clock.ahead_s):.4f} s {'ahead of' if found.clock.ahead_s > 0 else 'behind'}"
    sigma = f"± {found.sigma_s:.4f} s"
    drift = ""
    if found.drift_sigma is not None and abs(found.clock.drift) > 2.0 * found.drift_sigma:
        drift = f", drifts by {1e6 * found.clock.drift:.0f} parts in a million"
    return f"the clock of camera {found.camera} was {ahead} that of {first} ({sigma}{drift}), and was corrected"
