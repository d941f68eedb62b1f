"""A chart as HTML: rows above one another over one time axis, a slider that reads them, their numbers as a CSV link.

Pictures are stretched to the width there is while their lines and letters keep their size, so that the same markup does
for a phone, a screen and paper, and needs no script to be read.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import quote

import numpy as np

from anchorpose.report.axis import UNITS, Axis, Bins, round_step
from anchorpose.report.words import escape, number


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One picture of a chart: the label to its left, its height in pixels, SVG inside, labels at its edges in HTML."""

    label: str
    height: int
    shapes: str
    axis: Axis | None = None
    marks: str = ""
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the numbers behind a chart, one cell a group of frames, empty where nothing is known."""

    name: str
    cells: Sequence[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What the slider says of a series: which columns hold its text, or its lowest, highest, sigma and state."""

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
    """identity: its id on the page and the name of its CSV file; caption: HTML above it; source: HTML links below."""

    identity: str
    title: str
    caption: str
    rows: Sequence[Row]
    readings: Sequence[Reading]
    source: str = ""


def chart_html(chart: Chart, bins: Bins) -> str:
    """The chart as a figure element."""
    name, spec = escape(chart.identity), escape(_spec(chart.readings))
    rows = "".join(_row(row) for row in chart.rows)
    return (
        f"<figure class='chart' id='{name}' data-clock='{escape(bins.clock)}' data-readings='{spec}'>"
        f"<figcaption>{chart.caption}</figcaption>"
        f"<div class='pictures-in-time' role='img' aria-label='{escape(chart.title)}'>{rows}{time_axis(bins)}</div>"
        f"<div class='row reader'><label for='{name}-time'>time</label><input type='range' id='{name}-time' min='0' "
        f"max='{bins.count - 1}' value='0' step='1' aria-label='{escape(chart.title)}: move through time'></div>"
        f"<p class='readout'></p><p class='below'><a class='csv' download='{name}.csv' "
        f"href='data:text/csv;charset=utf-8,{_csv(chart.readings, bins)}'>numbers of this chart (CSV)</a>"
        f"{_sources(chart.source)}</p></figure>"
    )


def cells(values: np.ndarray, decimals: int, times: float = 1.0) -> list[str]:
    """Numbers (b,) for a CSV; empty where NaN."""
    return [f"{times * value:.{decimals}f}" if np.isfinite(value) else "" for value in values.tolist()]


def time_axis(bins: Bins) -> str:
    """Round seconds along the bottom."""
    begin, end = float(bins.time_s[0]), float(bins.time_s[-1])
    if end <= begin:
        return _axis_row(f"<i style='left:50%'>{number(begin, 2)} s</i>")
    step = round_step((end - begin) / 8.0)
    first, last = int(np.ceil(begin / step - 1e-9)), int(np.floor(end / step + 1e-9))
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    ticks = "".join(
        f"<i style='left:{100 * (step * k - begin) / (end - begin):.2f}%'>{number(step * k, decimals)} s</i>"
        for k in range(first, last + 1)
    )
    return _axis_row(ticks)


def _axis_row(ticks: str) -> str:
    return f"<div class='row axis'><span></span><div class='ticks'>{ticks}</div></div>"


def _row(row: Row) -> str:
    grid, labels = "", ""
    if row.axis is not None:
        grid = "".join(f"M0 {round(UNITS * top)}h{UNITS}" for top, _ in row.axis.labels())
        labels = "".join(_tick(top, text) for top, text in row.axis.labels())
    return (
        f"<div class='row {row.kind}' style='--tall:{row.height}px'><span class='label'>{row.label}</span>"
        f"<div class='plot'><div class='scale'>{labels}</div><svg viewBox='0 0 {UNITS} {UNITS}' "
        f"preserveAspectRatio='none' aria-hidden='true' focusable='false'><path class='grid' d='{grid}'/>{row.shapes}"
        f"</svg>{row.marks}<div class='cursor'></div></div></div>"
    )


def _sources(links: str) -> str:
    return f"<span>sources: {links}</span>" if links else ""


def _tick(top: float, text: str) -> str:
    """Inside of the row at its edges, so that the labels of two rows do not meet."""
    edge = "first" if top < 0.01 else "final" if top > 0.99 else ""
    return f"<i class='{edge}' style='top:{100 * top:.1f}%'>{text}</i>"


def _spec(readings: Sequence[Reading]) -> str:
    """For the page's script: of each series its label, its unit and the numbers of its columns in the CSV."""
    position, spec = _LEADING, []
    for reading in readings:
        entry: dict[str, object] = {"label": reading.label, "unit": reading.unit}
        for role, _ in reading.columns:
            entry[role] = position
            position += 1
        spec.append(entry)
    return json.dumps(spec, ensure_ascii=False, separators=(",", ":"))


_LEADING = 5


def _csv(readings: Sequence[Reading], bins: Bins) -> str:
    first, last = bins.frame[bins.start].tolist(), bins.frame[bins.last].tolist()
    leading = [
        Column("first_frame", [str(frame) for frame in first]),
        Column("last_frame", [str(frame) for frame in last]),
        Column("from_s", cells(bins.time_s[bins.start], 3)),
        Column("to_s", cells(bins.time_s[bins.last], 3)),
        Column("place", cells(bins.place, 4)),
    ]
    columns = leading + [column for reading in readings for _, column in reading.columns]
    lines = [",".join(column.name for column in columns)]
    lines += map(",".join, zip(*(column.cells for column in columns), strict=True))
    return quote("\n".join(lines) + "\n", safe=",;:.- ()_")
