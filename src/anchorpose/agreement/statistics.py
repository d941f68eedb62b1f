"""Compute bias and limits of agreement of repeated measurements, with confidence intervals.

The method is Bland and Altman 2007 (doi:10.1080/10543400701329422), for pairs of simultaneous values (one per system)
of a quantity that changes from pair to pair: the variance of a difference between the systems is the sum of the
variance within a unit and the variance between units, both from a one-way analysis of variance. A unit is a subject or,
with few subjects, a stretch of a recording. Confidence intervals are computed by MOVER, the "method of variance
estimates recovery" (Zou 2013, doi:10.1177/0962280211402548).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from anchorpose.results.uncertainty import CONFIDENCE, NORMAL_95

LEAST_UNITS: Final = 3
"""Minimum number of subjects at which each subject counts as a unit, and minimum number of units for confidence
intervals. With fewer units, an interval would be too wide to be useful.
"""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its 95 % interval; low and high are None if there are too few units for an interval."""

    value: float
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Bias (mean difference) and limits of agreement, between which 95 % of differences lie, in the values' unit."""

    count: int  # number of differences
    units: int  # number of units (subjects or stretches of a recording)
    bias: Estimate
    lower: Estimate
    upper: Estimate
    # standard deviation of differences within a unit; None if no unit has two differences
    within_sd: float | None
    # standard deviation of the units' true means (the scatter that sampling error causes is subtracted); None for a
    # single unit
    between_sd: float | None
    sd: float  # standard deviation of a single difference


def limits_of_agreement(difference: np.ndarray, unit: np.ndarray, independent: int | None = None) -> Limits:
    """Compute the limits of agreement. difference (n,): finite; unit (n,): the number or name of the unit (subject, or
    stretch of a recording) to which each difference belongs. independent: how many of the differences are independent,
    by default all n; the degrees of freedom of the variance within a unit are this number minus the number of units.

    Raises ValueError for fewer than two differences.
    """
    if len(difference) < 2:
        raise ValueError(f"{len(difference)} differences have no limits of agreement")
    _, index = np.unique(unit, return_inverse=True)
    size = np.bincount(index).astype(np.float64)
    mean = np.bincount(index, difference) / size
    units, count, bias = len(size), len(difference), float(difference.mean())
    within = float(((difference - mean[index]) ** 2).sum() / (count - units)) if count > units else None
    between = _between_variance(size, mean - bias, within or 0.0)
    sd = float(np.sqrt(between + (within or 0.0)))
    if units < LEAST_UNITS:
        ends = (Estimate(bias), Estimate(bias - NORMAL_95 * sd), Estimate(bias + NORMAL_95 * sd))
    else:
        freedom = (count if independent is None else independent) - units
        ends = _intervals(bias, sd, mean, size, (within or 0.0, freedom))
    return Limits(
        count=count,
        units=units,
        bias=ends[0],
        lower=ends[1],
        upper=ends[2],
        within_sd=None if within is None else float(np.sqrt(within)),
        between_sd=None if units == 1 else float(np.sqrt(between)),
        sd=sd,
    )


def _between_variance(size: np.ndarray, off: np.ndarray, within: float) -> float:
    """Return the variance between units, 0 for a single unit. size, off (units,): number of differences per unit, and
    the unit's mean minus the bias; within: variance within a unit.
    """
    units, count = len(size), size.sum()
    if units == 1:
        return 0.0
    pairs = (count**2 - (size**2).sum()) / ((units - 1) * count)
    return max((float((size * off**2).sum() / (units - 1)) - within) / pairs, 0.0)


def _intervals(
    bias: float, sd: float, mean: np.ndarray, size: np.ndarray, within: tuple[float, int]
) -> tuple[Estimate, Estimate, Estimate]:
    """Return bias, lower and upper limit with their intervals. mean, size (units,): mean and number of differences per
    unit. within: variance within a unit, and its degrees of freedom.
    """
    units, (variance, freedom) = len(mean), within
    bias_half = float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, units - 1) * _sigma_of_bias(mean, size, bias))
    harmonic = units / (1.0 / size).sum()
    parts = [(float(mean.var(ddof=1)), units - 1), ((1.0 - 1.0 / harmonic) * variance, freedom)]
    low, high = _variance_interval(sd**2, parts)
    shorter, longer = NORMAL_95 * (sd - np.sqrt(low)), NORMAL_95 * (np.sqrt(high) - sd)
    inner, outer = float(np.hypot(bias_half, shorter)), float(np.hypot(bias_half, longer))
    below, above = bias - NORMAL_95 * sd, bias + NORMAL_95 * sd
    return (
        Estimate(bias, bias - bias_half, bias + bias_half),
        Estimate(below, below - outer, below + inner),
        Estimate(above, above - inner, above + outer),
    )


def _sigma_of_bias(mean: np.ndarray, size: np.ndarray, bias: float) -> float:
    """Return the standard error of the bias. Units are independent, but differences within a unit are correlated."""
    share = size / size.sum()
    units = len(mean)
    return float(np.sqrt(units / (units - 1.0) * (share**2 * (mean - bias) ** 2).sum()))


def _variance_interval(variance: float, parts: list[tuple[float, int]]) -> tuple[float, float]:
    """Return the 95 % interval of ``variance``, a sum of independent variances, computed from the interval of each
    summand. parts: each summand and its degrees of freedom.
    """
    below, above = 0.0, 0.0
    for part, freedom in parts:
        if freedom > 0:
            low, high = stats.chi2.ppf([0.5 - CONFIDENCE / 2.0, 0.5 + CONFIDENCE / 2.0], freedom)
            below += (part * (1.0 - freedom / high)) ** 2
            above += (part * (freedom / low - 1.0)) ** 2
    return max(variance - float(np.sqrt(below)), 0.0), variance + float(np.sqrt(above))


LEAST_SAMPLES: Final = 10
"""Minimum number of samples (pairs of both systems' values) for computing agreement, or the coefficient of multiple
correlation (CMC) of two curves.
"""

LEVELS: Final = np.linspace(0.05, 0.95, 19)
"""Nominal shares of the errors that lie in a central interval (an interval around 0); ``calibration_error`` compares
each with the observed share.
"""


def waveform_correlation(values: np.ndarray, reference: np.ndarray) -> float | None:
    """Return the coefficient of multiple correlation (CMC) of two systems' curves (n,) of the same movement.

    The CMC is 1 where both curves coincide; offsets and gains between the curves lower it. It is None for fewer than
    ``LEAST_SAMPLES`` samples. It is also None if the two curves differ from each other by more than they vary over
    time, since the CMC would be the root of a negative number, and if both curves are the same constant. Source:
    Ferrari et al. 2010 (doi:10.1016/j.gaitpost.2009.09.009), for one cycle and two protocols.
    """
    if len(values) < LEAST_SAMPLES:
        return None
    both = np.stack([values, reference])
    between = ((both - both.mean(axis=0)) ** 2).sum() / len(values)
    overall = ((both - both.mean()) ** 2).sum() / (both.size - 1)
    return float(np.sqrt(1.0 - between / overall)) if 0.0 < overall >= between else None


def coverage_95(error: np.ndarray, sigma: np.ndarray) -> float:
    """Return the share of errors (n,) within 1.96 times their sigma (n,)."""
    return float((np.abs(error) <= stats.norm.ppf(0.975) * sigma).mean())


def calibration_error(error: np.ndarray, sigma: np.ndarray) -> float:
    """Return the expected calibration error of stated sigmas: how much the shares of errors within intervals of these
    sigmas differ from the intended shares. For each share in ``LEVELS``, the interval around 0 that should hold this
    share of the errors is computed from sigma; the result is the mean absolute difference between this share and the
    observed share.

    error, sigma (n,). The calibration error is 0 if the observed shares equal ``LEVELS``, and 0.5 if every sigma is far
    too small or far too large. Source: Kuleshov et al. 2018 (arXiv:1807.00263), for normal errors and central
    intervals.
    """
    within = np.abs(error / sigma)[None] <= stats.norm.ppf(0.5 + LEVELS / 2.0)[:, None]
    return float(np.abs(within.mean(axis=1) - LEVELS).mean())
