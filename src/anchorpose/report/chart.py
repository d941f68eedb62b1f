"""A chart: rows above one another over one time axis, what a slider reads of them, and their numbers as CSV.

Rows are stretched to the width there is while lines and letters keep their size (see ``templates/parts.html``), so that
the same markup serves a phone, a screen and paper, and needs no script to be read.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from anchorpose.report.session import Bins
from anchorpose.report.words import number

UNITS: Final = 1000
"""Rows are drawn on a square of this many units and stretched to their place: whole numbers keep the page small."""
MOST_TICKS: Final = 5

Spans = Sequence[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, slots=True)
class Axis:
    """From ``low`` at the bottom to ``high`` at the top."""

    low: float
    high: float
    ticks: tuple[float, ...]

    def down(self, value: np.ndarray) -> np.ndarray:
        """Whole units from the top; a value beyond the axis lies beyond the picture, by no more than its height."""
        place = (self.high - np.asarray(value, dtype=np.float64)) / (self.high - self.low)
        return np.round(UNITS * np.clip(place, -1.0, 2.0))

    def labels(self) -> list[tuple[float, str]]:
        """(share from the top, text) of each tick."""
        step = self.ticks[1] - self.ticks[0] if len(self.ticks) > 1 else 1.0
        decimals = max(0, -math.floor(math.log10(step) + 1e-9))
        return [((self.high - tick) / (self.high - self.low), number(tick, decimals)) for tick in self.ticks]


def make_axis(values: Spans, bands: Spans, least_span: float) -> Axis:
    """Holds all values, and as much of the bands as leaves the values at least half of the height.

    values, bands: (lowest, highest) pairs of arrays, NaN where not known. least_span: so that noise is not magnified.
    """
    low, high = _extremes(values)
    if low is None or high is None:
        return Axis(0.0, 1.0, ())
    span = max(high - low, least_span)
    middle = (low + high) / 2.0
    low, high = min(low, middle - span / 2.0), max(high, middle + span / 2.0)
    outer_low, outer_high = _extremes(bands)
    low = low if outer_low is None else max(min(low, outer_low), low - span / 2.0)
    high = high if outer_high is None else min(max(high, outer_high), high + span / 2.0)
    step = round_step((high - low) / MOST_TICKS)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return Axis(low, high, tuple(step * k for k in range(first, last + 1)))


def round_step(least: float) -> float:
    """The smallest of 1, 2, 5, 10, ... (and of their tenths, hundredths) that is at least ``least``."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= least * (1 - 1e-9))


def _extremes(spans: Spans) -> tuple[float | None, float | None]:
    known = [pair for pair in spans if np.isfinite(pair[0]).any()]
    if not known:
        return None, None
    return min(float(np.nanmin(low)) for low, _ in known), max(float(np.nanmax(high)) for _, high in known)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """A sign over a row: its text, its CSS class and place; link: where it leads; title: its name in words."""

    text: str
    kind: str
    style: str
    title: str = ""
    link: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One picture of a chart: the label to its left, its height in pixels, and what is drawn.

    shapes: (CSS class, SVG path) of each, in units of a square of ``UNITS``, stretched to the row. kind: a CSS class.
    """

    label: str
    height: int
    shapes: tuple[tuple[str, str], ...] = ()
    axis: Axis | None = None
    marks: tuple[Mark, ...] = ()
    kind: str = ""

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """(share from the top, text) of each number beside the row."""
        return [] if self.axis is None else self.axis.labels()

    @property
    def grid(self) -> str:
        """A line at each tick, as an SVG path."""
        return "".join(f"M0 {round(UNITS * top)}h{UNITS}" for top, _ in self.ticks)


def heading(label: str) -> Row:
    """The name of the rows below it."""
    return Row(label=label, height=0, kind="heading")


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the numbers behind a chart, one cell per group of frames, empty where nothing is known."""

    name: str
    cells: Sequence[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What the slider reads of a series: the columns with its text, or with its lowest, highest, sigma and state."""

    label: str
    unit: str = ""
    text: Column | None = None
    low: Column | None = None
    high: Column | None = None
    sigma: Column | None = None
    state: Column | None = None

    @property
    def columns(self) -> list[tuple[str, Column]]:
        """(role, column) of those that there are."""
        roles = ("text", "low", "high", "sigma", "state")
        return [(role, getattr(self, role)) for role in roles if getattr(self, role) is not None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """Rows above one another over one time axis.

    identity: its id on the page and the name of its CSV file; title: for those who cannot see it; caption: above it.
    """

    identity: str
    title: str
    caption: str
    rows: Sequence[Row]
    readings: Sequence[Reading]
    sources: Sequence[Markup]
    bins: Bins

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """(share of the width, text) of round seconds along the bottom."""
        begin, end = float(self.bins.time_s[0]), float(self.bins.time_s[-1])
        if end <= begin:
            return [(0.5, f"{number(begin, 2)} s")]
        step = round_step((end - begin) / 8.0)
        first, last = math.ceil(begin / step - 1e-9), math.floor(end / step + 1e-9)
        decimals = max(0, -math.floor(math.log10(step) + 1e-9))
        seconds = [step * k for k in range(first, last + 1)]
        return [((second - begin) / (end - begin), f"{number(second, decimals)} s") for second in seconds]

    @property
    def spec(self) -> str:
        """For the page's script: of each reading its label, its unit and the positions of its columns in the CSV."""
        position, spec = len(_leading_columns(self.bins)), []
        for reading in self.readings:
            entry: dict[str, object] = {"label": reading.label, "unit": reading.unit}
            for role, _ in reading.columns:
                entry[role] = position
                position += 1
            spec.append(entry)
        return json.dumps(spec, ensure_ascii=False, separators=(",", ":"))

    @property
    def csv(self) -> str:
        """The numbers of all readings, as the rest of a data address."""
        columns = _leading_columns(self.bins) + [column for reading in self.readings for _, column in reading.columns]
        lines = [",".join(column.name for column in columns)]
        lines += map(",".join, zip(*(column.cells for column in columns), strict=True))
        return quote("\n".join(lines) + "\n", safe=",;:.- ()_")


def _leading_columns(bins: Bins) -> list[Column]:
    """Which frames each group holds, from when to when, and where it lies on the time axis."""
    return [
        Column("first_frame", [str(frame) for frame in bins.frame[bins.start].tolist()]),
        Column("last_frame", [str(frame) for frame in bins.frame[bins.last].tolist()]),
        Column("from_s", cells(bins.time_s[bins.start], 3)),
        Column("to_s", cells(bins.time_s[bins.last], 3)),
        Column("place", cells(bins.place, 4)),
    ]


def cells(values: np.ndarray, decimals: int) -> list[str]:
    """Numbers (b,) for a CSV; empty where NaN."""
    return [f"{value:.{decimals}f}" if np.isfinite(value) else "" for value in values.tolist()]
