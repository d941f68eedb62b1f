"""One clock per camera from the lags measured between pairs of cameras at several times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

ROUNDS: Final = 20  # lags removed one at a time; more are never wrong
DRIFT_SIGMA: Final = 1e-4  # a quartz clock is accurate to 100 parts in a million
OUTLIER_GATE: Final = 5.0  # deviations


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


def fit_clocks(lags: Sequence[PairLag], cameras: int) -> ClockFit:
    """Weighted least squares of all clocks at once, each drift with a prior of 0 ± ``DRIFT_SIGMA``.

    The worst lag is removed while it is more than ``OUTLIER_GATE`` deviations off. The standard errors grow with the
    scatter that is left. Raises ValueError without lags.
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
    """(2 * cameras,) how the lag depends on (ahead, drift) of each clock; the first camera's are 0."""
    row = np.zeros(2 * cameras)
    row[2 * lag.second : 2 * lag.second + 2] = 1.0, lag.at_s - at_s
    row[2 * lag.first : 2 * lag.first + 2] = -1.0, at_s - lag.at_s
    row[:2] = 0.0
    return row


def _solve(lags: Sequence[PairLag], cameras: int, at_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Values (2 * cameras,) and their covariance."""
    rows = np.array([_row(lag, cameras, at_s) for lag in lags])
    weight = np.array([lag.sigma_s**-2 for lag in lags])
    information = (rows * weight[:, None]).T @ rows
    information[np.arange(1, 2 * cameras, 2), np.arange(1, 2 * cameras, 2)] += DRIFT_SIGMA**-2
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
