"""What is found as rows: a method, a column, a mean with its interval; as CSV files and, pivoted, on the page."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from anchorpose.experiments.method import Method
from anchorpose.experiments.presentation.statistics import Estimate


class Unit(StrEnum):
    """What a column is told in."""

    MM = "mm"
    SHARE = "share"  # 0 to 1 in files, per cent for readers
    RATIO = "ratio"
    SECONDS = "s"


class Frames(StrEnum):
    """Which frames a table rests on."""

    ALL = "all frames"  # of the methods that ran on all of them
    SAME = "same frames"  # only those that all methods ran on: what methods may be compared by


@dataclass(frozen=True, slots=True)
class Column:
    """key: in files; label: for readers, with the unit where that is not the table's subject."""

    key: str
    label: str
    unit: Unit = Unit.MM


@dataclass(frozen=True, slots=True)
class Row:
    """One method's figure in one column."""

    method: Method
    column: Column
    value: Estimate


@dataclass(frozen=True, slots=True)
class Table:
    """key: name of the file; across: what the columns are; note: what a reader must know, in sentences.

    rows: method by method, each with its columns in the same order; a method may lack some.
    """

    key: str
    title: str
    across: str
    note: str
    rows: tuple[Row, ...]

    @property
    def columns(self) -> list[Column]:
        """In the order of their first appearance."""
        return list(dict.fromkeys(row.column for row in self.rows))

    @property
    def methods(self) -> list[Method]:
        """Likewise."""
        by_key = {row.method.key: row.method for row in self.rows}
        return list(by_key.values())

    def value(self, method: str, column: str) -> Estimate:
        """Of a method's and a column's keys; NaN where the table has none."""
        for row in self.rows:
            if row.method.key == method and row.column.key == column:
                return row.value
        return Estimate(np.nan, np.nan, np.nan, 0)


def csv_text(table: Table) -> str:
    """One line a figure; empty where a number is not known."""
    out = io.StringIO()
    lines = csv.writer(out, lineterminator="\n")
    lines.writerow(["method", "title", "family", table.across, "unit", "mean", "low", "high", "recordings"])
    for row in table.rows:
        value = row.value
        numbers = [_number(each) for each in (value.mean, value.low, value.high)]
        lines.writerow(
            [row.method.key, row.method.title, row.method.family, row.column.key, row.column.unit, *numbers,
             value.count]
        )  # fmt: skip
    return out.getvalue()


def told(value: Estimate, unit: Unit) -> str:
    """For readers: the mean and the interval, such as "48.2 (45.0 to 51.3)"; a dash where nothing is known."""
    if np.isnan(value.mean):
        return "–"
    if np.isnan(value.low):
        return one_told(value.mean, unit)
    low = one_told(value.low, unit).removesuffix(" %")
    return f"{one_told(value.mean, unit)} ({low} to {one_told(value.high, unit).removesuffix(' %')})"


def one_told(number: float, unit: Unit) -> str:
    """A number as precisely as anybody needs it; the unit is said elsewhere, but per cent."""
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
