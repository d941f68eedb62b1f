"""Find the difference between the clocks of another motion capture system and of the results, from the movement that
both recorded. "Ours" means the results of this program, "theirs" the other system's recording.

Distances between joints, and angles, do not depend on the frame of reference. So the clocks of the two systems can be
compared before the relative pose of their frames of reference is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import correlate

from anchorpose.calibration.clock_lags import DRIFT_SIGMA
from anchorpose.errors import AnchorposeError

GRID_HZ: Final = 100.0
"""Rate in Hz of the evenly spaced times (the grid) at which signals are compared; movement is smooth within the 10 ms
between two such times.
"""

SMOOTHING_S: Final = 0.04
"""Standard deviation, in s, of the Gaussian kernel that smooths the signals of both systems. The kernel passes
frequencies up to 4 Hz, and most movements of people are slower.
"""

LONGEST_GAP_S: Final = 0.15
"""Maximum time in s of a gap in a signal that is interpolated; gaps of up to 1.5 frame intervals are interpolated,
too.
"""

MOST_SIGNALS: Final = 40  # maximum number of compared signals; the signals that vary most are used

LEAST_MOVEMENT_M: Final = 0.02
LEAST_MOVEMENT_DEG: Final = 4.0
"""Minimum standard deviation, over the recording, of a distance between joints (``LEAST_MOVEMENT_M``, m) or of an angle
(``LEAST_MOVEMENT_DEG``, degrees) for it to be used as a signal. With less movement, the signal would be mostly noise.
"""

LEAST_KNOWN: Final = 0.2
"""Minimum share of the frames with a known value, for a signal to be used."""


@dataclass(frozen=True, slots=True, eq=False)
class Signals:
    """Signals (distances, angles or coordinates) at evenly spaced times. time_s (g,): times in steps of 1 /
    ``GRID_HZ``; values (g, k): one column per signal, NaN in gaps. ``common_signals`` and ``position_signals`` divide
    lengths by ``LEAST_MOVEMENT_M``, angles by ``LEAST_MOVEMENT_DEG``, so that lengths and angles, which have different
    units, have comparable weights.
    """

    time_s: np.ndarray
    values: np.ndarray


def common_signals(
    ours: tuple[np.ndarray, np.ndarray, np.ndarray], theirs: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> tuple[Signals, Signals] | None:
    """Return corresponding signals of the two systems. A signal is the distance between two joints, or an angle; only
    signals that both systems have, and that vary enough in both recordings, are used. Return None if no signal
    qualifies.

    ours, theirs: time_s (n,), position_m (n, 21, 3) and degrees (n, a) of one system, NaN where missing. Both systems
    have the same angles in the same order.
    """
    columns = [_raw(position, degrees) for _, position, degrees in (ours, theirs)]
    known = np.minimum(*(np.isfinite(each).mean(axis=0) for each in columns))
    spread = np.minimum(*(_spread(each) for each in columns))
    angles = ours[2].shape[1]
    least = np.append(np.full(len(spread) - angles, LEAST_MOVEMENT_M), np.full(angles, LEAST_MOVEMENT_DEG))
    moving = spread / least
    moving[(known < LEAST_KNOWN) | ~np.isfinite(moving)] = 0.0
    best = np.argsort(-moving, kind="stable")[:MOST_SIGNALS]
    best = best[moving[best] >= 1.0]
    if not len(best):
        return None
    both = [
        on_grid(time_s, (each / least)[:, best]) for (time_s, _, _), each in zip((ours, theirs), columns, strict=True)
    ]
    return both[0], both[1]


def position_signals(time_s: np.ndarray, position_m: np.ndarray) -> Signals:
    """Return the coordinates (n, 21, 3) of joints as signals, one per joint and axis; they must be in a frame of
    reference that both systems share. Coordinates contain more information than the distances between joints that
    ``common_signals`` uses.
    """
    return on_grid(time_s, position_m.reshape(len(time_s), -1) / LEAST_MOVEMENT_M)


def _raw(position_m: np.ndarray, degrees: np.ndarray) -> np.ndarray:
    pairs = np.array(list(combinations(range(position_m.shape[1]), 2)))
    distance = np.linalg.norm(position_m[:, pairs[:, 0]] - position_m[:, pairs[:, 1]], axis=2)
    return np.concatenate([distance, degrees], axis=1)


def _spread(values: np.ndarray) -> np.ndarray:
    """Return the standard deviation (k,) of the known values of each column; NaN where fewer than two are known."""
    count = np.isfinite(values).sum(axis=0)
    filled = np.nan_to_num(values)
    mean = filled.sum(axis=0) / np.maximum(count, 1)
    square = (np.where(np.isfinite(values), values - mean, 0.0) ** 2).sum(axis=0)
    return np.where(count > 1, np.sqrt(square / np.maximum(count - 1, 1)), np.nan)


def on_grid(time_s: np.ndarray, values: np.ndarray, smoothing_s: float = SMOOTHING_S) -> Signals:
    """Interpolate values (n, k) at times (n,), NaN where missing, to evenly spaced times, and smooth them with a
    Gaussian kernel of standard deviation ``smoothing_s``. Values are not scaled.
    """
    grid_s = np.arange(time_s[0], time_s[-1], 1.0 / GRID_HZ)
    found = np.stack([at_times(time_s, values[:, column], grid_s) for column in range(values.shape[1])], axis=1)
    known = np.isfinite(found)
    width = smoothing_s * GRID_HZ
    weight = gaussian_filter1d(known.astype(np.float64), width, axis=0, mode="constant")
    smooth = gaussian_filter1d(np.nan_to_num(found), width, axis=0, mode="constant")
    # Near a gap or an end of the signal, the kernel covers fewer samples on one side than on the other. Smoothing would
    # then shift the movement in time, so values there are left out.
    whole = known & (weight > 0.95)
    return Signals(grid_s, np.where(whole, smooth / np.where(whole, weight, 1.0), np.nan))


def at_times(time_s: np.ndarray, values: np.ndarray, wanted_s: np.ndarray) -> np.ndarray:
    """Interpolate values (n,) linearly at the times wanted_s (m,). The result is NaN before the first and after the
    last known value, and in gaps that are longer than both ``LONGEST_GAP_S`` and 1.5 frame intervals.
    """
    known = np.isfinite(values)
    if known.sum() < 2:
        return np.full(len(wanted_s), np.nan)
    times, heights = time_s[known], values[known]
    usual_s = float(np.median(np.diff(time_s)))
    after = np.clip(np.searchsorted(times, wanted_s), 1, len(times) - 1)
    near = times[after] - times[after - 1] <= max(LONGEST_GAP_S, 1.5 * usual_s)
    inside = (wanted_s >= times[0]) & (wanted_s <= times[-1])
    return np.where(near & inside, np.interp(wanted_s, times, heights), np.nan)


def resampled(time_s: np.ndarray, values: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """Interpolate each column of values (t, ...) at the times ``at_s`` (n,) by ``at_times``, which leaves long gaps
    NaN; return (n, ...).
    """
    flat = values.reshape(len(time_s), -1)
    found = np.full((len(at_s), flat.shape[1]), np.nan)
    for column in np.flatnonzero(np.isfinite(flat).any(axis=0)):
        found[:, column] = at_times(time_s, flat[:, column], at_s)
    return found.reshape(len(at_s), *values.shape[1:])


COARSE: Final = 4
"""Interval between the samples that the first search for the clock offset uses: every fourth sample of each signal."""

LEAST_OVERLAP: Final = 0.4
"""Minimum common time of both recordings, as a share of the shorter recording; in less time, movements may agree by
chance.
"""

LEAST_OVERLAP_S: Final = 3.0  # s, minimum time that both recordings must have in common, even if a recording is short

# Minimum correlation of the systems' signals at the best offset; with a smaller correlation, NoCommonMovement is raised
LEAST_CORRELATION: Final = 0.6

RIVAL_DISTANCE_S: Final = 0.5
RIVAL_FACTOR: Final = 1.5
"""Limits for a rival: a second offset that fits as well as the best offset. A peak of the correlation at an offset more
than ``RIVAL_DISTANCE_S`` from the best offset is a rival if the share of the movement that it leaves unexplained (1 -
correlation^2) is less than ``RIVAL_FACTOR`` times the share that the best offset leaves unexplained. The movement then
repeats itself and does not determine the offset.
"""

ITERATIONS: Final = 20  # maximum number of least-squares steps
# Number of stretches of equal duration into which the common time of both recordings is divided; the jackknife omits
# one stretch at a time
BLOCKS: Final = 10
HUBER: Final = 2.5  # limit of a residual, in robust standard deviations of its signal; larger residuals get less weight


class NoCommonMovement(AnchorposeError):
    """The error for two recordings that do not show the same movement, or that do not determine how their clocks
    differ.
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherClock:
    """The clock of the other system: when the clock of the results shows t, it shows ``t + offset_s + drift * (t -
    middle_s)``. So ``middle_s`` is the time (on the clock of the results) at which the clocks differ by exactly
    ``offset_s``. Sigmas are standard deviations.

    overlap_s: times of the first and the last sample that both systems measured, on the clock of the results.
    """

    offset_s: float
    offset_sigma_s: float
    drift: float
    drift_sigma: float
    middle_s: float
    overlap_s: tuple[float, float]

    def reference_time_s(self, time_s: np.ndarray) -> np.ndarray:
        """Convert times (n,) on the clock of the results to times on the other system's clock."""
        return time_s + self.offset_s + self.drift * (time_s - self.middle_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock(OtherClock):
    """A clock found from movement. correlation: correlation between both systems' signals at the best offset."""

    correlation: float


def find_clock(ours: Signals, theirs: Signals) -> Clock:
    """Find the offset and drift of the other system's clock, with their uncertainty, from corresponding signals of both
    systems.

    Raises NoCommonMovement if the best offset explains too little of the movement, or another offset explains as much.
    """
    r, overlap = _correlations(ours.values[::COARSE], theirs.values[::COARSE])
    return refine_clock(ours, theirs, starting_clock(*offset_of_peak(ours, theirs, r, overlap)))


def starting_clock(offset_s: float, correlation: float) -> Clock:
    """Return a clock with an approximate offset and no known drift."""
    return Clock(
        offset_s=offset_s,
        offset_sigma_s=np.inf,
        drift=0.0,
        drift_sigma=DRIFT_SIGMA,
        middle_s=0.0,
        correlation=correlation,
        overlap_s=(0.0, 0.0),
    )


def refine_clock(ours: Signals, theirs: Signals, clock: Clock, with_drift: bool = True) -> Clock:
    """Refine ``clock`` by least squares. The offset of ``clock`` must be nearly right already: with an error longer
    than a single movement (such as one bend of the knee), the steps may end at a wrong offset.

    with_drift: if False, drift and its sigma stay as in ``clock``, for recordings that are too short to show a drift.
    Raises NoCommonMovement if the two recordings have too few samples at the same times.
    """
    offset_s, drift, middle_s = clock.offset_s, clock.drift, clock.middle_s
    free = slice(2 if with_drift else 1)
    for _ in range(ITERATIONS):
        blocks = _normal_equations(ours, theirs, offset_s, drift, middle_s)
        if blocks is None:
            raise NoCommonMovement("the two recordings have too little in common")
        matrix, right, known_s, centre_s = blocks
        matrix, right = matrix[:, free, free], right[:, free]
        offset_s, middle_s = offset_s + drift * (centre_s - middle_s), centre_s
        step = np.append(np.linalg.solve(matrix.sum(axis=0), right.sum(axis=0)), 0.0)
        offset_s, drift = offset_s + float(step[0]), drift + float(step[1])
        if abs(step[0]) < 1e-7 and abs(step[1]) < 1e-9:
            break
    sigma = np.append(_jackknife(matrix, right), DRIFT_SIGMA)
    overlap_s = (float(known_s[0]), float(known_s[-1]))
    found = replace(clock, offset_s=offset_s, offset_sigma_s=float(sigma[0]), middle_s=middle_s, overlap_s=overlap_s)
    if not with_drift:
        return found
    # combine the drift with its prior, which has mean 0 and standard deviation DRIFT_SIGMA
    share = DRIFT_SIGMA**2 / (DRIFT_SIGMA**2 + sigma[1] ** 2)
    return replace(found, drift=share * drift, drift_sigma=float(np.sqrt(share) * sigma[1]))


def offset_of_peak(
    ours: Signals,
    theirs: Signals,
    r: np.ndarray,
    overlap: np.ndarray,
    least_s: float = LEAST_OVERLAP_S,
    near_s: float | None = None,
) -> tuple[float, float]:
    """Return the offset of the other system's clock, in seconds, at which the signals of both systems match best, and
    their correlation at this offset.

    r, overlap: correlation of the signals and number of common samples at each lag, as ``_correlations`` returns them
    if it gets every ``COARSE``-th sample of both systems' signals. least_s: minimum common time of both recordings in
    s; lags with less common time are not considered. near_s: an estimate of the offset that is wrong by at most
    ``RIVAL_DISTANCE_S``; None if unknown. Raises NoCommonMovement if the best correlation is too small, or another
    offset explains as much of the movement.
    """
    a, b = ours.values[::COARSE], theirs.values[::COARSE]
    least = max(LEAST_OVERLAP * min(len(a), len(b)), least_s * GRID_HZ / COARSE)
    lag_s = (np.arange(len(r)) - (len(a) - 1)) * COARSE / GRID_HZ
    considered = overlap >= least
    if near_s is not None:
        considered &= np.abs(theirs.time_s[0] - ours.time_s[0] + lag_s - near_s) <= RIVAL_DISTANCE_S
    if not considered.any():
        raise NoCommonMovement(f"they have less than {least * COARSE / GRID_HZ:.1f} s in common")
    r = np.where(considered, r, -1.0)
    # The best lag has the largest product of r^2 (r is the correlation) and overlap. With r alone, a short overlap
    # could win by chance.
    best = int(np.argmax(r * np.sqrt(np.where(considered, overlap, 0.0))))
    if r[best] < LEAST_CORRELATION:
        raise NoCommonMovement(f"the best correlation of their movements is {max(r[best], 0.0):.2f}")
    peaks = np.flatnonzero((r[1:-1] >= r[:-2]) & (r[1:-1] >= r[2:])) + 1
    far = peaks[np.abs(lag_s[peaks] - lag_s[best]) > RIVAL_DISTANCE_S]
    rivals = far[1.0 - np.maximum(r[far], 0.0) ** 2 < RIVAL_FACTOR * (1.0 - r[best] ** 2)]
    offset_s = theirs.time_s[0] - ours.time_s[0] + lag_s
    if len(rivals):
        other = rivals[np.argmax(r[rivals])]
        raise NoCommonMovement(
            f"the movement repeats itself, so that offsets of {offset_s[best]:.2f} and {offset_s[other]:.2f} s explain "
            "it equally well"
        )
    return float(offset_s[best]), float(r[best])


def _correlations(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each lag of ``b`` behind ``a``, the correlation over all signals and the mean number of common
    samples.

    a (n, k), b (m, k): corresponding signals of both systems, NaN where missing. The correlation is -1 where it is
    undefined. At the lag with index i, a[j] is compared with b[j + i - (len(a) - 1)].
    """
    covariance, of_a, of_b, count = (np.zeros(len(a) + len(b) - 1) for _ in range(4))
    for column in range(a.shape[1]):
        x, y = a[:, column], b[:, column]
        seen_x, seen_y = np.isfinite(x).astype(float), np.isfinite(y).astype(float)
        centre = np.mean(x[seen_x > 0]) if seen_x.any() else 0.0
        x, y = np.nan_to_num(x - centre), np.nan_to_num(y - centre)
        n, sum_x, sum_y, xx, yy, xy = (
            correlate(second, first, method="fft")
            for first, second in ((seen_x, seen_y), (x, seen_y), (seen_x, y), (x * x, seen_y), (seen_x, y * y), (x, y))
        )
        n = np.rint(n)
        some = np.maximum(n, 1.0)
        covariance += xy - sum_x * sum_y / some
        of_a += np.maximum(xx - sum_x**2 / some, 0.0)
        of_b += np.maximum(yy - sum_y**2 / some, 0.0)
        count += n
    scale = np.sqrt(of_a * of_b)
    floor = 1e-6 * max(float(scale.max()), 1e-12)
    return np.where(scale > floor, covariance / np.where(scale > floor, scale, 1.0), -1.0), count / a.shape[1]


def _normal_equations(
    ours: Signals, theirs: Signals, offset_s: float, drift: float, middle_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float] | None:
    """Return the normal equations of the least-squares step that improves a clock, separately for each of ``BLOCKS``
    stretches of equal duration. The two unknowns are the change of the offset, at the centre of the common time of both
    recordings, and the change of the drift.

    Return matrices (``BLOCKS``, 2, 2), right sides (``BLOCKS``, 2), the times of the samples that both systems
    measured, and the weighted centre of these times; None if the two systems have too few such samples.
    """
    at_s = ours.time_s + offset_s + drift * (ours.time_s - middle_s)
    place = (at_s - theirs.time_s[0]) * GRID_HZ
    inside = (place >= 1) & (place < len(theirs.time_s) - 2)
    if inside.sum() < 2 * BLOCKS:
        return None
    base, share = np.floor(place[inside]).astype(int), (place[inside] % 1.0)[:, None]
    before, after = theirs.values[base], theirs.values[base + 1]
    y, slope = before + share * (after - before), (after - before) * GRID_HZ
    error = ours.values[inside] - y
    weight = np.isfinite(error).astype(float)
    seen = weight.sum(axis=0)
    used = seen > 2 * BLOCKS
    if not used.any():
        return None
    error, slope, weight = error[:, used], np.nan_to_num(slope[:, used]), weight[:, used]
    centred = np.nan_to_num(error - np.nanmedian(error, axis=0))
    spread = 1.4826 * np.median(np.abs(centred), axis=0) + 1e-3
    weight = weight / spread**2 * np.minimum(1.0, HUBER * spread / np.maximum(np.abs(centred), 1e-12))
    time_s = ours.time_s[inside]
    rows = weight.sum(axis=1)
    known_s, centre_s = time_s[rows > 0], float((rows * time_s).sum() / rows.sum())
    since = (time_s - centre_s)[:, None]
    parts = [_without_mean(each, weight) for each in (np.nan_to_num(error), slope, slope * since)]
    block = np.minimum((BLOCKS * (time_s - time_s[0]) / (time_s[-1] - time_s[0] + 1e-9)).astype(int), BLOCKS - 1)
    products = np.stack([(weight * parts[i] * parts[j]).sum(axis=1) for i in range(3) for j in range(3)], axis=1)
    summed = np.stack([np.bincount(block, column, BLOCKS) for column in products.T], axis=1).reshape(BLOCKS, 3, 3)
    return summed[:, 1:, 1:], summed[:, 1:, 0], known_s, centre_s


def _without_mean(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Subtract from each signal (column) its weighted mean. A constant difference between the systems, which different
    definitions of joints cause, then has no influence.
    """
    return np.where(weight > 0, values - (weight * values).sum(axis=0) / weight.sum(axis=0), 0.0)


def _jackknife(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the standard deviations (2,) of offset and drift, or (1,) of the offset alone, from their changes when
    each stretch of the common time of both recordings is left out in turn.

    Errors of neighbouring frames are correlated, so sigmas computed from single frames would be far too small.
    """
    total, side = matrix.sum(axis=0), right.sum(axis=0)
    kept = [k for k in range(len(matrix)) if matrix[k].any() and np.linalg.cond(total - matrix[k]) < 1e12]
    steps = np.array([np.linalg.solve(total - matrix[k], side - right[k]) for k in kept])
    count = len(kept)
    return np.sqrt((count - 1.0) / count * ((steps - steps.mean(axis=0)) ** 2).sum(axis=0))
