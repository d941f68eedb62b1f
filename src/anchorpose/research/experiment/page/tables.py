"""Define tables, and compute their values: means, medians and ratios of errors, with confidence intervals.

In CSV files, each value (of one method in one column) has a line of its own; on the page, all values of a method stand
in one line. Confidence intervals are computed by the bootstrap, which draws whole recordings, not frames.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.stats import t as student

from anchorpose.recording.document import cell_text
from anchorpose.research.experiment.method import Method

NORMAL_TAIL = 1.959964  # in standard deviations: half of the width of the normal distribution's 95 % interval
BOOTSTRAP_KEY = 13  # seed of the bootstrap's random draws
MEDIAN_STEPS = 1024  # number of quantiles, 0.1 % apart, to which the ends of a median's interval are rounded


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean, median, ratio or standard deviation (field ``mean``), and its 95 % interval; NaN without values."""

    mean: float
    low: float
    high: float
    count: int  # number of recordings; with fewer than two, the interval is NaN


def mean_over(groups: Sequence[np.ndarray], resamples: int) -> Estimate:
    """Return the mean of all values of all groups; NaN values are left out.

    A group has the values of one recording. The bootstrap draws groups instead of values, since the frames of a
    recording are correlated. Source: Efron 1979 (doi:10.1214/aos/1176344552).
    """
    sums, counts = _sums(groups)
    if counts.sum() == 0:
        return Estimate(np.nan, np.nan, np.nan, 0)
    mean = float(sums.sum() / counts.sum())
    if len(sums) < 2:
        return Estimate(mean, np.nan, np.nan, len(sums))
    return _with_interval(mean, _resampled(sums, counts, resamples), len(sums))


def ratio_of(above: Sequence[np.ndarray], below: Sequence[np.ndarray], resamples: int) -> Estimate:
    """Return the ratio of two means over the same recordings; NaN if the denominator is 0.

    above, below: one group of values per recording. The bootstrap draws the two groups of a recording together.
    """
    if len(above) != len(below):
        raise ValueError(f"a ratio needs the same recordings above and below, got {len(above)} and {len(below)}")
    sums = [_sums(groups, keep_empty=True) for groups in (above, below)]
    known = (sums[0][1] > 0) & (sums[1][1] > 0)
    (a, n), (b, m) = ((s[known], c[known]) for s, c in sums)
    if not known.any() or b.sum() == 0:
        return Estimate(np.nan, np.nan, np.nan, 0)
    ratio = float((a.sum() / n.sum()) / (b.sum() / m.sum()))
    if known.sum() < 2:
        return Estimate(ratio, np.nan, np.nan, int(known.sum()))
    draws = _draws(len(a), resamples)
    with np.errstate(divide="ignore", invalid="ignore"):  # the denominator of a draw may be 0
        each = (a[draws].sum(1) / n[draws].sum(1)) / (b[draws].sum(1) / m[draws].sum(1))
    return _with_interval(ratio, each, len(a))


def deviation_over(groups: Sequence[np.ndarray], resamples: int) -> Estimate:
    """Return the standard deviation of all values of all groups; a group has the values of one recording."""
    sums, counts = _sums(groups)
    squares, _ = _sums([np.asarray(group, dtype=np.float64) ** 2 for group in groups])
    if counts.sum() == 0:
        return Estimate(np.nan, np.nan, np.nan, 0)

    def deviation(rows: np.ndarray) -> np.ndarray:
        total = counts[rows].sum(-1)
        variance = squares[rows].sum(-1) / total - (sums[rows].sum(-1) / total) ** 2
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    value = float(deviation(np.arange(len(sums))))
    if len(sums) < 2:
        return Estimate(value, np.nan, np.nan, len(sums))
    return _with_interval(value, deviation(_draws(len(sums), resamples)), len(sums))


def median_over(groups: Sequence[np.ndarray], resamples: int) -> Estimate:
    """Return the median of all values of all groups; a group has the values of one recording.

    The median is exact; the ends of its interval are rounded to ``MEDIAN_STEPS`` quantiles of the values.
    """
    finite = [np.asarray(group, dtype=np.float64).ravel() for group in groups]
    finite = [kept for group in finite if len(kept := group[np.isfinite(group)])]
    if not finite:
        return Estimate(np.nan, np.nan, np.nan, 0)
    together = np.concatenate(finite)
    if len(finite) < 2:
        return Estimate(float(np.median(together)), np.nan, np.nan, 1)
    steps = np.unique(np.quantile(together, np.linspace(0, 1, MEDIAN_STEPS + 1), method="lower"))
    below = np.array([np.searchsorted(np.sort(group), steps, side="right") for group in finite], dtype=np.float64)
    sizes = np.array([len(group) for group in finite], dtype=np.float64)
    draws = _draws(len(finite), resamples)
    times = np.stack([(draws == index).sum(axis=1) for index in range(len(finite))], axis=1).astype(np.float64)
    medians = steps[(times @ below >= (times @ sizes / 2.0)[:, None]).argmax(axis=1)]
    return _with_interval(float(np.median(together)), medians, len(finite))


def _with_interval(value: float, drawn: np.ndarray, count: int) -> Estimate:
    """Return a value with its interval: percentiles of its bootstrap draws, which are moved apart to correct for the
    small number ``count`` of recordings.

    The bootstrap's interval of n values is too narrow by sqrt((n - 1) / n), and has the tails of the normal
    distribution instead of Student's (Hesterberg 2015, doi:10.1080/00031305.2015.1089789). With four recordings, a 95 %
    interval that is not widened contains the truth in 82 % of cases. If all draws are positive, the interval is
    widened on a logarithmic scale, so that intervals of errors and ratios stay above zero.
    """
    low, high = (float(bound) for bound in np.quantile(drawn, [0.025, 0.975]))
    wider = float(np.sqrt(count / (count - 1)) * student.ppf(0.975, count - 1) / NORMAL_TAIL)
    if np.nanmin(drawn) > 0:
        return Estimate(value, value * (low / value) ** wider, value * (high / value) ** wider, count)
    return Estimate(value, value + wider * (low - value), value + wider * (high - value), count)


def _sums(groups: Sequence[np.ndarray], keep_empty: bool = False) -> tuple[np.ndarray, np.ndarray]:
    values = [np.asarray(group, dtype=np.float64) for group in groups]
    counts = np.array([np.isfinite(value).sum() for value in values], dtype=np.int64)
    sums = np.array([value[np.isfinite(value)].sum() for value in values], dtype=np.float64)
    kept = np.ones(len(counts), bool) if keep_empty else counts > 0
    return sums[kept], counts[kept]


def _resampled(sums: np.ndarray, counts: np.ndarray, resamples: int) -> np.ndarray:
    draws = _draws(len(sums), resamples)
    means: np.ndarray = sums[draws].sum(axis=1) / counts[draws].sum(axis=1)
    return means


def _draws(count: int, resamples: int) -> np.ndarray:
    rng = np.random.default_rng(np.random.SeedSequence(BOOTSTRAP_KEY))
    draws: np.ndarray = rng.integers(0, count, size=(resamples, count))
    return draws


class Unit(StrEnum):
    """The unit of a column."""

    MM = "mm"
    SHARE = "share"  # 0 to 1 in files, per cent for readers
    RATIO = "ratio"
    SECONDS = "s"


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table."""

    key: str  # name in files
    label: str  # name for readers, with the column's unit if this differs from the table's unit
    unit: Unit = Unit.MM


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a table: the value of one method in one column."""

    method: Method
    column: Column
    value: Estimate


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the experiment."""

    key: str  # name of the table's file
    title: str
    across: str  # name of the quantity by which columns differ
    note: str  # sentences that a reader of the table must know
    # sorted by method; columns have the same order for every method, but a method may lack some columns
    rows: tuple[Row, ...]

    @property
    def columns(self) -> list[Column]:
        """Return the columns in the order of their first appearance."""
        return list(dict.fromkeys(row.column for row in self.rows))

    @property
    def methods(self) -> list[Method]:
        """Return the methods in the order of their first appearance."""
        by_key = {row.method.key: row.method for row in self.rows}
        return list(by_key.values())

    def value(self, method: str, column: str) -> Estimate:
        """Return the value by the keys of method and column; NaN if the table has no such value."""
        for row in self.rows:
            if row.method.key == method and row.column.key == column:
                return row.value
        return Estimate(np.nan, np.nan, np.nan, 0)


def csv_text(table: Table) -> str:
    """Return the table as CSV, one line per value; an unknown number is an empty cell."""
    out = io.StringIO()
    lines = csv.writer(out, lineterminator="\n")
    lines.writerow(["method", "title", "family", table.across, "unit", "mean", "low", "high", "recordings"])
    for row in table.rows:
        value = row.value
        numbers = [_number(each) for each in (value.mean, value.low, value.high)]
        lines.writerow(
            [
                row.method.key,
                cell_text(row.method.title),
                row.method.family,
                row.column.key,
                row.column.unit,
                *numbers,
                value.count,
            ]
        )
    return out.getvalue()


def format_estimate(value: Estimate, unit: Unit) -> str:
    """Format the mean and the interval for readers, for example "48.2 (45.0 to 51.3)"; NaN is a dash."""
    if np.isnan(value.mean):
        return "–"
    if np.isnan(value.low):
        return format_number(value.mean, unit)
    low = format_number(value.low, unit).removesuffix(" %")
    return f"{format_number(value.mean, unit)} ({low} to {format_number(value.high, unit).removesuffix(' %')})"


def format_number(number: float, unit: Unit) -> str:
    """Format a number with as many decimals as suit its unit; the unit is not written, except for per cent."""
    match unit:
        case Unit.MM:
            return f"{number:.1f}".replace("-", "−")
        case Unit.SHARE:
            return f"{100 * number:.1f} %"
        case Unit.RATIO:
            return f"{number:.2f}"
        case Unit.SECONDS:
            return f"{number:.3g}"


def _number(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.6g}"
