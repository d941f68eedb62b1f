"""Find the clock of an inertial sensor: compare its signals with the tracked movement of the segment it is strapped to.

The sensor's orientation on the segment (its mounting) is unknown. So for each time offset that is tried (lag), the
program first finds the rotation that best maps the sensor's axes to the segment's axes (Schönemann 1966,
doi:10.1007/BF02289451). The correlation after this rotation does not depend on the mounting. The sensor's axes may be
left-handed, and a single axis is enough.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.signal import correlate

from anchorpose.agreement.clock import (
    COARSE,
    Clock,
    NoCommonMovement,
    Signals,
    offset_of_peak,
    refine_clock,
    starting_clock,
)

LEAST_DRIFT_S: Final = 60.0
"""Minimum common time in s of both signals for which the drift is fitted. In a shorter time, the drift's prior (100
parts in a million) is more precise than a fit, since offsets are known only to 5 ms.
"""

LEAST_OVERLAP_S: Final = 1.5
"""Minimum common time in s of both signals, about the time that one movement such as standing up takes."""

SHORT_S: Final = 10.0
LEAST_SHORT_CORRELATION: Final = 0.9
"""Minimum correlation if the common time is below ``SHORT_S`` (s), since a short movement may by chance correlate with
a different one. In four real recordings of 2.5 to 5 s, the correlation with the right sensor file was 0.90 to 0.99.
"""

LARGEST_MISFIT: Final = 0.7
"""Maximum of ``_mean_misfit`` of accelerations if the common time is below ``SHORT_S``. After rotation, the signals of
a different movement may correlate by chance, but gravity then seldom has the right direction and size. In fourteen real
recordings, the misfit of the right sensor file was 0.15 to 0.67.
"""

SENSOR_SIGMA_S: Final = 0.01
"""Sigma in s of the offset's error due to the movement of skin and muscle under a sensor. The accelerometer and the
gyroscope of one sensor on the thigh gave offsets 10 ms apart, although each offset was certain to within 8 ms.
"""

ROUNDS: Final = 3
"""Number of rounds in which clock and mounting are fitted in turn; both are nearly correct after the first round."""


def find_sensor_clock(ours: Signals, theirs: Signals, near_s: float | None = None, has_gravity: bool = False) -> Clock:
    """Find the sensor's clock relative to the clock of the tracked segment.

    ours (g, 3): signals of the tracked segment, along its axes; theirs (h, k), k from 1 to 3: signals of the sensor,
    along its axes. Units are arbitrary. near_s: an offset that is correct within half a second, None if unknown.
    has_gravity: whether both are accelerations of three axes. Raises NoCommonMovement if the best offset explains too
    little of the movement, or if another offset explains as much of the movement.
    """
    r, overlap = rotated_correlations(ours.values[::COARSE], theirs.values[::COARSE])
    clock = starting_clock(*offset_of_peak(ours, theirs, r, overlap, LEAST_OVERLAP_S, near_s))
    for _ in range(ROUNDS):
        mounting, correlation = _mounting(ours, theirs, clock)
        turned = Signals(theirs.time_s, theirs.values @ mounting)
        clock = refine_clock(ours, turned, clock, with_drift=False)
    common_s = clock.overlap_s[1] - clock.overlap_s[0]
    if near_s is None and common_s < SHORT_S:
        if correlation < LEAST_SHORT_CORRELATION:
            raise NoCommonMovement(f"the best correlation of their movements is {correlation:.2f} in {common_s:.1f} s")
        if has_gravity and _mean_misfit(ours, turned, clock) > LARGEST_MISFIT:
            raise NoCommonMovement(f"their movements in {common_s:.1f} s fit, but gravity does not")
    if common_s >= LEAST_DRIFT_S:
        clock = refine_clock(ours, turned, clock)
    sigma_s = float(np.hypot(clock.offset_sigma_s, SENSOR_SIGMA_S))
    return replace(clock, offset_sigma_s=sigma_s, correlation=correlation)


def rotated_correlations(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each lag of b (m, k) behind a (n, 3), the correlation after the best rotation, and the number of
    pairs of samples from which it is computed.

    Samples (rows of a and b) with a NaN are left out. The lag with index i pairs a[j] with b[j + i - (n - 1)].
    """
    (a, seen_a), (b, seen_b) = _centred(a), _centred(b)
    count = np.maximum(np.rint(_sums(seen_a, seen_b)), 0.0)
    some = np.maximum(count, 1.0)
    sum_a = np.stack([_sums(x, seen_b) for x in a.T], axis=1)
    sum_b = np.stack([_sums(seen_a, y) for y in b.T], axis=1)
    products = np.stack([[_sums(x, y) for y in b.T] for x in a.T]).transpose(2, 0, 1)
    covariance = products - sum_a[:, :, None] * sum_b[:, None, :] / some[:, None, None]
    of_a = _sums((a**2).sum(axis=1), seen_b) - (sum_a**2).sum(axis=1) / some
    of_b = _sums(seen_a, (b**2).sum(axis=1)) - (sum_b**2).sum(axis=1) / some
    common = np.linalg.svd(covariance, compute_uv=False).sum(axis=1)
    scale = np.sqrt(np.maximum(of_a, 0.0) * np.maximum(of_b, 0.0))
    known = scale > 1e-6 * max(float(scale.max()), 1e-12)
    return np.where(known, common / np.where(known, scale, 1.0), -1.0), count


def _centred(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the values less their mean, 0 in rows with a NaN; and an array (n,): 0.0 for these rows, 1.0 for other
    rows.
    """
    seen = np.isfinite(values).all(axis=1)
    mean = values[seen].mean(axis=0) if seen.any() else 0.0
    return np.where(seen[:, None], np.nan_to_num(values - mean), 0.0), seen.astype(np.float64)


def _sums(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return, for each lag (n + m - 1,), the sum of the products ``first * second`` over the samples that this lag
    pairs.
    """
    return np.asarray(correlate(second, first, method="fft"))


def _mounting(ours: Signals, theirs: Signals, clock: Clock) -> tuple[np.ndarray, float]:
    """Return the matrix (k, 3), a rotation times a scale, that maps the sensor's values to the segment's axes and unit;
    and the correlation after this rotation.

    clock: a clock that is nearly correct. Raises NoCommonMovement if the two signals have no time in common.
    """
    x, y = (each - each.mean(axis=0) for each in _in_common(ours, theirs, clock))
    u, common, vt = np.linalg.svd(y.T @ x, full_matrices=False)
    shared, of_x, of_y = float(common.sum()), float((x**2).sum()), float((y**2).sum())
    return u @ vt * (shared / of_y), shared / float(np.sqrt(of_x * of_y))


def _mean_misfit(ours: Signals, turned: Signals, clock: Clock) -> float:
    """Return the distance between the mean vectors of segment and sensor, divided by the mean length of the segment's
    vectors. turned: the sensor's vectors in the axes and unit of the segment.
    """
    x, y = _in_common(ours, turned, clock)
    return float(np.linalg.norm(x.mean(axis=0) - y.mean(axis=0)) / np.linalg.norm(x, axis=1).mean())


def _in_common(ours: Signals, theirs: Signals, clock: Clock) -> tuple[np.ndarray, np.ndarray]:
    """Return the values of the segment (c, 3) and of the sensor (c, k) at the times when both are known; raises
    NoCommonMovement without such times.
    """
    at_s = clock.reference_time_s(ours.time_s)
    found = np.stack([np.interp(at_s, theirs.time_s, y, np.nan, np.nan) for y in theirs.values.T], axis=1)
    both = np.isfinite(found).all(axis=1) & np.isfinite(ours.values).all(axis=1)
    if not both.any():
        raise NoCommonMovement("the two recordings have too little in common")
    return ours.values[both], found[both]
