"""How well measures repeat: intraclass correlations, standard error of measurement, minimal detectable change.

Two-way analysis of variance by statsmodels; ICC(2,1) and ICC(3,1) of Shrout and Fleiss 1979
(doi:10.1037/0033-2909.86.2.420) with the intervals of McGraw and Wong 1996 (doi:10.1037/1082-989X.1.1.30); standard
error of measurement and minimal detectable change of Weir 2005 (doi:10.1519/15184.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from scipy import stats

from anchorpose.errors import MissingPackage
from anchorpose.results.uncertainty import NORMAL_95

LEAST_SUBJECTS: Final = 3
TAIL: Final = 0.975


@dataclass(frozen=True, slots=True, kw_only=True)
class Reliability:
    """Of one measure; None where ``why`` states the reason. sem and mdc95 are in ``unit``."""

    measure: str
    side: str | None
    unit: str
    subjects: int
    repeats: int
    mean: float | None = None
    icc_2_1: float | None = None
    icc_2_1_low: float | None = None
    icc_2_1_high: float | None = None
    icc_3_1: float | None = None
    icc_3_1_low: float | None = None
    icc_3_1_high: float | None = None
    sem: float | None = None
    mdc95: float | None = None
    why: str | None = None


COLUMNS: Final = tuple(each.name for each in fields(Reliability))


@dataclass(frozen=True, slots=True)
class MeanSquares:
    """Of a two-way analysis of variance: between subjects, between repeats, and the rest."""

    subjects: float
    repeats: float
    rest: float


@dataclass(frozen=True, slots=True)
class Correlation:
    """An intraclass correlation with its 95 % interval."""

    value: float
    low: float
    high: float


def mean_squares(values: np.ndarray) -> MeanSquares:
    """values (subjects, repeats), all finite. Raises MissingPackage without statsmodels."""
    try:
        from pandas import DataFrame
        from statsmodels.formula.api import ols
        from statsmodels.stats.anova import anova_lm
    except ImportError:
        raise MissingPackage("anchorpose reliability", "statsmodels", "reliability") from None
    subjects, repeats = np.indices(values.shape)
    # centred, so that a large mean costs no digits
    table = DataFrame(
        {"value": (values - values.mean()).ravel(), "subject": subjects.ravel(), "repeated": repeats.ravel()}
    )
    found = anova_lm(ols("value ~ C(subject) + C(repeated)", table).fit())
    subject, repeated, rest = (float(found["mean_sq"][name]) for name in ("C(subject)", "C(repeated)", "Residual"))
    return MeanSquares(subject, repeated, rest)


def absolute_agreement(ms: MeanSquares, subjects: int, repeats: int) -> Correlation:
    """ICC(2,1): repeats are a sample of all, and their differences count as error."""
    n, k = subjects, repeats
    value = (ms.subjects - ms.rest) / (ms.subjects + (k - 1) * ms.rest + k * (ms.repeats - ms.rest) / n)
    a = k * value / (n * (1.0 - value))
    b = 1.0 + k * value * (n - 1) / (n * (1.0 - value))
    freedom = (a * ms.repeats + b * ms.rest) ** 2 / (
        (a * ms.repeats) ** 2 / (k - 1) + (b * ms.rest) ** 2 / ((n - 1) * (k - 1))
    )
    above, below = stats.f.ppf(TAIL, n - 1, freedom), stats.f.ppf(TAIL, freedom, n - 1)
    other = k * ms.repeats + (k * n - k - n) * ms.rest
    low = n * (ms.subjects - above * ms.rest) / (above * other + n * ms.subjects)
    high = n * (below * ms.subjects - ms.rest) / (other + n * below * ms.subjects)
    return Correlation(float(value), float(low), float(high))


def consistency(ms: MeanSquares, subjects: int, repeats: int) -> Correlation:
    """ICC(3,1): a constant difference between repeats does not count as error."""
    n, k = subjects, repeats
    ratio, freedom = ms.subjects / ms.rest, (n - 1) * (k - 1)
    low, high = ratio / stats.f.ppf(TAIL, n - 1, freedom), ratio * stats.f.ppf(TAIL, freedom, n - 1)
    value, below, above = ((each - 1.0) / (each + k - 1.0) for each in (ratio, low, high))
    return Correlation(float(value), float(below), float(above))


def reliability_of(measure: str, side: str | None, unit: str, values: np.ndarray) -> Reliability:
    """values (subjects, repeats), NaN where there is none: such subjects are left out."""
    whole = values[np.isfinite(values).all(axis=1)]
    subjects, repeats = whole.shape
    empty = Reliability(measure=measure, side=side, unit=unit, subjects=subjects, repeats=repeats)
    why = _why_not(whole)
    if why is not None:
        return replace(empty, why=why)
    ms = mean_squares(whole)
    if ms.rest <= 1e-12 * ms.subjects:
        return replace(empty, why="all repeats are equal but for a constant: not measured")
    agreement, same = absolute_agreement(ms, subjects, repeats), consistency(ms, subjects, repeats)
    sem = float(np.sqrt(max((ms.repeats - ms.rest) / subjects, 0.0) + ms.rest))
    return replace(
        empty,
        mean=float(whole.mean()),
        icc_2_1=agreement.value,
        icc_2_1_low=agreement.low,
        icc_2_1_high=agreement.high,
        icc_3_1=same.value,
        icc_3_1_low=same.low,
        icc_3_1_high=same.high,
        sem=sem,
        mdc95=minimal_detectable_change(sem),
    )


def without_values(row: Reliability, why: str) -> Reliability:
    """The same measure without a value, and why."""
    kept = {name: getattr(row, name) for name in ("measure", "side", "unit", "subjects", "repeats")}
    return Reliability(**kept, why=why)


def minimal_detectable_change(sem: float) -> float:
    """The least difference of two values that errors alone exceed only 5 times in 100."""
    return float(NORMAL_95 * np.sqrt(2.0) * sem)


def _why_not(whole: np.ndarray) -> str | None:
    if whole.shape[1] < 2:
        return "only one session was given"
    if len(whole) < LEAST_SUBJECTS:
        return f"{len(whole)} subjects have a value in every session; at least {LEAST_SUBJECTS} are needed"
    return "the value never differs" if np.ptp(whole) == 0.0 else None


def find(rows: Sequence[Reliability], measure: str, side: str | None) -> Reliability | None:
    """The row of a measure; None where there is none."""
    return next((row for row in rows if (row.measure, row.side) == (measure, side)), None)
