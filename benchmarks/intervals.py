"""Compute intervals of shares and of paired differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from anchorpose.results.uncertainty import NORMAL_95


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 % score interval of a share. Source: Wilson 1927 (doi:10.1080/01621459.1927.10502953)."""
    if not 0 <= successes <= trials or trials == 0:
        raise ValueError(f"{successes} of {trials} is no share")
    share, z2 = successes / trials, NORMAL_95**2
    middle = (share + z2 / (2 * trials)) / (1 + z2 / trials)
    half = NORMAL_95 / (1 + z2 / trials) * np.sqrt(share * (1 - share) / trials + z2 / (4 * trials**2))
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedDifference:
    """Mean of n differences and its 95 % interval; low and high are None if n is 1."""

    pairs: int
    mean: float
    low: float | None
    high: float | None


def paired_difference(one: Sequence[float], other: Sequence[float]) -> PairedDifference | None:
    """Return the mean of ``one`` minus ``other``, pair by pair, with Student's t interval; None without a pair.

    A pair in which either value is NaN is left out.
    """
    away = np.asarray(one, dtype=np.float64) - np.asarray(other, dtype=np.float64)
    away = away[np.isfinite(away)]
    if len(away) == 0:
        return None
    mean = float(away.mean())
    if len(away) == 1:
        return PairedDifference(pairs=1, mean=mean, low=None, high=None)
    half = float(stats.t.ppf(0.975, len(away) - 1) * away.std(ddof=1) / np.sqrt(len(away)))
    return PairedDifference(pairs=len(away), mean=mean, low=mean - half, high=mean + half)
