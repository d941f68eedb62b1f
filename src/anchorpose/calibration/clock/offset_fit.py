"""One clock a camera from the lags measured between pairs of cameras at several times.

Where in a recording to look at the clocks: a few short windows in which much moves, not every picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from anchorpose.recording.depth_image import Footage

ROUNDS: Final = 20  # lags taken out one at a time; more are never wrong


@dataclass(frozen=True, slots=True)
class PairLag:
    """lag_s: what the clock of camera ``second`` shows less that of ``first``, at the reference time at_s."""

    first: int
    second: int
    at_s: float
    lag_s: float
    sigma_s: float


@dataclass(frozen=True, slots=True, eq=False)
class ClockFit:
    """ahead_s, drift (cameras,): of each clock against the first camera's, at at_s, NaN where no lag reaches it;
    covariance (cameras, 2, 2) of both; used: the lags that were kept; residual_s: their root mean square."""

    at_s: float
    ahead_s: np.ndarray
    drift: np.ndarray
    covariance: np.ndarray
    used: tuple[PairLag, ...]
    residual_s: float

    def sigma_s(self, camera: int, time_s: float) -> float:
        """Standard error of a camera's clock at a reference time."""
        row = np.array([1.0, time_s - self.at_s])
        return float(np.sqrt(row @ self.covariance[camera] @ row))


def fit_clocks(lags: Sequence[PairLag], cameras: int, drift_sigma: float, outlier_gate: float) -> ClockFit:
    """Weighted least squares of all clocks at once; a drift is taken to be 0 +- drift_sigma before anything is seen.

    The worst lag is taken out while it is more than ``outlier_gate`` deviations off. The standard errors grow with the
    scatter that is left. Raises ValueError without lags.
    """
    if not lags:
        raise ValueError("clocks need at least one lag")
    kept = list(lags)
    at_s = float(np.average([lag.at_s for lag in lags], weights=[lag.sigma_s**-2 for lag in lags]))
    for _ in range(ROUNDS):
        values, covariance = _solve(kept, cameras, at_s, drift_sigma)
        off = np.array([_row(lag, cameras, at_s) @ values - lag.lag_s for lag in kept])
        deviations = np.abs(off) / [lag.sigma_s for lag in kept]
        if len(kept) <= 2 or deviations.max() <= outlier_gate * max(1.0, float(np.median(deviations))):
            break
        del kept[int(deviations.argmax())]
    known = 2 * len({camera for lag in kept for camera in (lag.first, lag.second)} - {0})
    excess = max(1.0, float((deviations**2).sum()) / max(1, len(kept) - known // 2))
    reached = _reached(kept, cameras)
    values = np.where(np.repeat(reached, 2), values, np.nan).reshape(cameras, 2)
    blocks = np.array([covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(cameras)]) * excess
    return ClockFit(at_s, values[:, 0], values[:, 1], blocks, tuple(kept), float(np.sqrt(np.mean(off**2))))


def _row(lag: PairLag, cameras: int, at_s: float) -> np.ndarray:
    """(2 * cameras,) how the lag depends on (ahead, drift) of each clock; the first camera's are 0."""
    row = np.zeros(2 * cameras)
    row[2 * lag.second : 2 * lag.second + 2] = 1.0, lag.at_s - at_s
    row[2 * lag.first : 2 * lag.first + 2] = -1.0, at_s - lag.at_s
    row[:2] = 0.0
    return row


def _solve(lags: Sequence[PairLag], cameras: int, at_s: float, drift_sigma: float) -> tuple[np.ndarray, np.ndarray]:
    rows = np.array([_row(lag, cameras, at_s) for lag in lags])
    weight = np.array([lag.sigma_s**-2 for lag in lags])
    information = (rows * weight[:, None]).T @ rows
    information[np.arange(1, 2 * cameras, 2), np.arange(1, 2 * cameras, 2)] += drift_sigma**-2
    ahead = np.arange(0, 2 * cameras, 2)
    information[ahead, ahead] += 1e-12 * (weight.max() + 1.0)  # cameras that no lag reaches
    covariance = np.linalg.inv(information)
    covariance[:2] = covariance[:, :2] = 0.0
    return covariance @ (rows.T @ (weight * [lag.lag_s for lag in lags])), covariance


def _reached(lags: Sequence[PairLag], cameras: int) -> np.ndarray:
    """(cameras,) bool: linked to the first camera by lags, directly or through others."""
    reached = np.arange(cameras) == 0
    for _ in range(cameras):
        for lag in lags:
            if reached[lag.first] or reached[lag.second]:
                reached[[lag.first, lag.second]] = True
    return reached


STEP_PX = 8  # every eighth pixel of every eighth row tells how much moves
APART_S = 0.2  # between the two pictures that are compared
LEAST_CHANGE_M, MOST_CHANGE_M = 0.02, 0.15  # noise; and another surface that appears


def busiest_times(
    footage: Footage, reference: int, span_s: tuple[float, float], windows: int, places: int
) -> list[tuple[float, float]]:
    """(time on the reference clock, how much moves there in m^3) of the busiest place of each of ``windows`` parts.

    Each part of ``span_s`` is looked at in ``places`` places, two pictures each; a part without pictures has no entry.
    """
    edges = np.linspace(*span_s, windows + 1)
    found = []
    for begin_s, end_s in pairwise(edges):
        looked = begin_s + (np.arange(places) + 0.5) * (end_s - begin_s) / places
        amounts = [(_amount(footage, reference, time_s), float(time_s)) for time_s in looked]
        amount, time_s = max(amounts)
        if amount >= 0:
            found.append((time_s, amount))
    return found


def pictures_between(footage: Footage, camera: int, begin_s: float, end_s: float) -> list[tuple[float, np.ndarray]]:
    """(time, depth) of the usable pictures of a camera between two times of its own clock."""
    times_s = footage.times_s[camera]
    first, last = np.searchsorted(times_s, [begin_s, end_s])
    found = ((float(times_s[k]), footage.read(camera, k)) for k in range(first, last))
    return [(time_s, depth) for time_s, depth in found if depth is not None]


def _amount(footage: Footage, camera: int, time_s: float) -> float:
    """Area times change between two pictures at a time; -1 where they are missing."""
    times_s = footage.times_s[camera]
    first, last = np.clip(np.searchsorted(times_s, [time_s, time_s + APART_S]), 0, len(times_s) - 1)
    if first == last:
        return -1.0
    before, after = footage.read(camera, int(first)), footage.read(camera, int(last))
    if before is None or after is None:
        return -1.0
    lens = footage.cameras[camera].intrinsics
    before, after = before[::STEP_PX, ::STEP_PX], after[::STEP_PX, ::STEP_PX]
    change = np.abs(after - before)
    moved = (before > 0) & (after > 0) & (change > LEAST_CHANGE_M)
    near = np.minimum(before, after)[moved]
    return float((np.minimum(change[moved], MOST_CHANGE_M) * near**2).sum() * STEP_PX**2 / (lens.fx * lens.fy))
