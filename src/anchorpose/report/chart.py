"""Build a chart: rows of pictures over a common time axis, the values that a slider shows, and these values as CSV.

The page stretches rows to the available width, while lines and letters keep their size (see ``templates/parts.html``).
So the same HTML, without a script, is readable on a phone, on a large screen and on paper.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal
from urllib.parse import quote

import numpy as np

from anchorpose.report.words import number

MOST_BINS: Final = 600
"""Maximum number of groups of frames in a chart; each group is drawn as one point. With this number of groups, a group
is about one and a half pixels wide on a page, and a third of a millimetre on paper.
"""

PAUSE: Final = 3.0
"""Maximum interval between two successive frames, as a multiple of the median interval. A longer interval is a pause,
across which no line is drawn.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Groups of neighbouring frames; each group is drawn as one point. frame, time_s (n,): number and time of every
    frame. start (b,): index of each group's first frame in these two arrays.

    after_pause (b,) bool: a pause precedes the group, so no line connects it with the previous group. clock: the name
    of the session on a page with several sessions, else empty; charts with the same clock share the slider's position.
    """

    frame: np.ndarray
    time_s: np.ndarray
    start: np.ndarray
    after_pause: np.ndarray
    clock: str = ""

    @property
    def count(self) -> int:
        """Return the number of groups of frames."""
        return len(self.start)

    @property
    def last(self) -> np.ndarray:
        """Return (b,) the index of the last frame of each group of frames."""
        return np.append(self.start[1:], len(self.frame)) - 1

    @property
    def thinned(self) -> bool:
        """Return whether any group of frames, which is drawn as one point, holds more than one frame."""
        return self.count < len(self.frame)

    @property
    def place(self) -> np.ndarray:
        """Return (b,) the middle of each group of frames on the time axis, from 0 (first frame) to 1 (last frame)."""
        middle = (self.time_s[self.start] + self.time_s[self.last]) / 2.0
        return self.place_of(middle)

    def place_of(self, time_s: np.ndarray) -> np.ndarray:
        """Return the place of each time on the time axis: 0 = first frame, 1 = last frame; 0.5 if only one frame
        exists.
        """
        span = self.time_s[-1] - self.time_s[0]
        return (time_s - self.time_s[0]) / span if span > 0 else np.full(np.shape(time_s), 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class Envelope:
    """The lowest and highest known value of each group of frames (see ``Bins``), (b,) each, NaN if no frame of the
    group has a value.

    rising (b,) bool: whether the lowest value is earlier than the highest.
    """

    low: np.ndarray
    high: np.ndarray
    rising: np.ndarray


def make_bins(frame: np.ndarray, time_s: np.ndarray, clock: str = "", most: int = MOST_BINS) -> Bins:
    """Divide the frames into at most ``most`` groups of equal size. With at most ``most`` frames, each frame is a
    group.
    """
    count = min(len(frame), most)
    start = np.arange(count) * len(frame) // count
    return Bins(frame, time_s, start, np.logical_or.reduceat(after_pause(time_s), start), clock)


def after_pause(time_s: np.ndarray) -> np.ndarray:
    """Return (n,) bool: True for frames that a pause separates from the previous frame."""
    step = np.diff(time_s)
    return np.append(False, step > PAUSE * np.median(step)) if len(step) else np.zeros(1, dtype=bool)


def envelope(values: np.ndarray, bins: Bins) -> Envelope:
    """Compute the lowest and highest of values (n,), NaN where unknown, in each group of frames."""
    low, high = np.fmin.reduceat(values, bins.start), np.fmax.reduceat(values, bins.start)
    group = np.repeat(np.arange(bins.count), np.diff(np.append(bins.start, len(values))))
    rows = np.arange(len(values))
    at_low = np.minimum.reduceat(np.where(values == low[group], rows, len(values)), bins.start)
    at_high = np.minimum.reduceat(np.where(values == high[group], rows, len(values)), bins.start)
    return Envelope(low, high, at_low <= at_high)


def worst(state_code: np.ndarray, bins: Bins) -> np.ndarray:
    """Return (b,) the largest of the state codes (n,) in each group of frames. Worse states have larger codes, so this
    is the code of the group's worst state.
    """
    return np.maximum.reduceat(state_code, bins.start)


UNITS: Final = 1000
"""Width and height of the drawing of a row, which the page stretches to the row's size. Coordinates in the drawing are
whole numbers, which keeps the page small.
"""
MOST_TICKS: Final = 5

Spans = Sequence[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, slots=True)
class Axis:
    """A vertical axis from ``low`` at the bottom to ``high`` at the top."""

    low: float
    high: float
    ticks: tuple[float, ...]

    def down(self, value: np.ndarray) -> np.ndarray:
        """Convert values to distances from the top of the picture, in whole units (``UNITS`` per picture height). A
        value beyond the axis is placed outside the picture, at most one picture height away.
        """
        place = (self.high - np.asarray(value, dtype=np.float64)) / (self.high - self.low)
        return np.round(UNITS * np.clip(place, -1.0, 2.0))

    def labels(self) -> list[tuple[float, str]]:
        """Return (place, text) of each tick; place: distance from the top as a share of the axis's height."""
        step = self.ticks[1] - self.ticks[0] if len(self.ticks) > 1 else 1.0
        decimals = max(0, -math.floor(math.log10(step) + 1e-9))
        return [((self.high - tick) / (self.high - self.low), number(tick, decimals)) for tick in self.ticks]


def make_axis(values: Spans, bands: Spans, least_span: float) -> Axis:
    """Make an axis whose range covers all values.

    The range also covers the uncertainty bands. But a wide band is cut off if the values would otherwise fill less than
    half of the axis's height and look flat. values, bands: (lowest, highest) pairs of arrays, NaN where unknown.
    least_span: minimum range of the axis, so that noise is not magnified.
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
    """Return the smallest round number that is at least ``least``; round numbers are 1, 2, 5, 10, ..., and also their
    tenths, hundredths and so on.
    """
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= least * (1 - 1e-9))


def _extremes(spans: Spans) -> tuple[float | None, float | None]:
    known = [pair for pair in spans if np.isfinite(pair[0]).any()]
    if not known:
        return None, None
    return min(float(np.nanmin(low)) for low, _ in known), max(float(np.nanmax(high)) for _, high in known)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """A sign drawn over a row of a chart. kind: CSS class; style: CSS that places the sign; title: the sign's meaning;
    link: the address that opens when the sign is clicked, or empty.
    """

    text: str
    kind: str
    style: str
    title: str = ""
    link: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One picture of a chart: the label to its left, its height in pixels, and its shapes.

    shapes: (CSS class, SVG path) of each shape, drawn in a square of ``UNITS`` that is stretched to the row. kind: a
    CSS class.
    """

    label: str
    height: int
    shapes: tuple[tuple[str, str], ...] = ()
    axis: Axis | None = None
    marks: tuple[Mark, ...] = ()
    kind: str = ""

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Return (place, text) of each number beside the row, as ``Axis.labels`` does."""
        return [] if self.axis is None else self.axis.labels()

    @property
    def grid(self) -> str:
        """Return a horizontal line at each tick, as an SVG path."""
        return "".join(f"M0 {round(UNITS * top)}h{UNITS}" for top, _ in self.ticks)


def heading(label: str) -> Row:
    """Return a row that is the heading of the rows below."""
    return Row(label=label, height=0, kind="heading")


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a chart's CSV, with one cell per group of frames; a cell is empty if the group has no known value."""

    name: str
    cells: Sequence[str]


Role = Literal["text", "low", "high", "sigma", "state"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """The values that the page's slider shows for a curve or row at the chosen time. columns: the CSV columns that hold
    these values, by role: ``text`` alone, or the lowest and the highest value of each group of frames (``low``,
    ``high``) and, for a curve, also ``sigma`` and ``state``.
    """

    label: str
    unit: str = ""
    columns: dict[Role, Column]


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """Rows (one picture each) over a common time axis.

    identity: id of the chart on the page and name of its CSV file; title: description for people who cannot see the
    chart; caption: text above the chart; sources: the tables that the chart is drawn from.
    """

    identity: str
    title: str
    caption: str
    rows: Sequence[Row]
    readings: Sequence[Reading]
    sources: Sequence[str]
    bins: Bins

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Return (share of the width, text) of each tick along the bottom; ticks are at round numbers of seconds."""
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
        """Return JSON for the page's script: each reading's label, unit and positions of its columns in the CSV."""
        position, spec = len(_leading_columns(self.bins)), []
        for reading in self.readings:
            entry: dict[str, object] = {"label": reading.label, "unit": reading.unit}
            for role in reading.columns:
                entry[role] = position
                position += 1
            spec.append(entry)
        return json.dumps(spec, ensure_ascii=False, separators=(",", ":"))

    @property
    def csv(self) -> str:
        """Return the numbers of all readings as CSV, escaped for a ``data:`` URL."""
        columns = _leading_columns(self.bins) + [column for each in self.readings for column in each.columns.values()]
        lines = [",".join(column.name for column in columns)]
        lines += map(",".join, zip(*(column.cells for column in columns), strict=True))
        return quote("\n".join(lines) + "\n", safe=",;:.- ()_")


def _leading_columns(bins: Bins) -> list[Column]:
    """Return the columns that begin every CSV: numbers and times of each group's first and last frame, and the group's
    place on the time axis.
    """
    return [
        Column("first_frame", [str(frame) for frame in bins.frame[bins.start].tolist()]),
        Column("last_frame", [str(frame) for frame in bins.frame[bins.last].tolist()]),
        Column("from_s", cells(bins.time_s[bins.start], 3)),
        Column("to_s", cells(bins.time_s[bins.last], 3)),
        Column("place", cells(bins.place, 4)),
    ]


def lowest_and_highest(name: str, values: np.ndarray, bins: Bins, decimals: int) -> dict[Role, Column]:
    """Return two columns of the CSV: the lowest and the highest of ``values`` in each group of frames. name: column
    name with a placeholder for "lowest" or "highest".
    """
    line = envelope(values, bins)
    low = Column(name.format("lowest"), cells(line.low, decimals))
    return {"low": low, "high": Column(name.format("highest"), cells(line.high, decimals))}


def cells(values: np.ndarray, decimals: int) -> list[str]:
    """Format numbers (b,) as cells of a CSV; NaN gives an empty cell."""
    return [f"{value:.{decimals}f}" if np.isfinite(value) else "" for value in values.tolist()]
