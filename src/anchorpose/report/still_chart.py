"""Build a static chart: measured points with their errors, and lines with uncertainty bands, over any horizontal axis.

As in the curves over time, the line of the left side is solid and that of the right side dashed. Points are round for
the left side and square for the right side. Colour adds no information. Every number of a chart is in the table below
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.report.chart import UNITS, Envelope, Row, make_axis
from anchorpose.report.curves import end_marks

HEIGHT: Final = 170
MARGIN: Final = 0.06
"""Share of the chart's width that stays empty at each end, so that no point lies on the border."""

APART: Final = 6
"""Distance between left and right points of the same x, in units (``UNITS`` per width), so that both are visible."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drawn:
    """The drawn points and line of one side ("left", "right" or ""). x (n,), y (n,): measured values; reach (n,): half
    length of each error bar, or NaN. line_x, line_y (k,): the line; low, high (k,): edges of its uncertainty band, NaN
    where it has no band.
    """

    side: str
    x: np.ndarray
    y: np.ndarray
    reach: np.ndarray
    line_x: np.ndarray
    line_y: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class StillChart:
    """A static chart. identity: id of the chart on the page; title: description for people who cannot see the chart;
    caption: text above the chart; row: the picture; ticks: (share of the width, text) along the bottom; head, rows: the
    numbers as a table whose cells are texts.
    """

    identity: str
    title: str
    caption: str
    row: Row
    ticks: Sequence[tuple[float, str]]
    head: Sequence[str]
    rows: Sequence[tuple[str, Sequence[str]]]


def across(values: np.ndarray, span: tuple[float, float]) -> np.ndarray:
    """Convert values to shares of the width, with ``MARGIN`` free at either end. span: least and greatest value."""
    low, high = span
    share = (values - low) / (high - low) if high > low else np.full(np.shape(values), 0.5)
    return MARGIN + (1.0 - 2.0 * MARGIN) * np.asarray(share, dtype=np.float64)


def still_row(label: str, sides: Sequence[Drawn], span: tuple[float, float]) -> Row:
    """Return the chart's picture. label: text of the vertical axis; span: the least and the greatest x."""
    values = [(y, y) for each in sides for y in (each.y, each.line_y)]
    bands = [(np.where(np.isnan(s.reach), s.y, s.y - s.reach), s.y + np.nan_to_num(s.reach)) for s in sides]
    bands += [(np.fmin(each.low, each.line_y), np.fmax(each.high, each.line_y)) for each in sides]
    known = [float(value) for low, _ in values for value in low if np.isfinite(value)]
    size = max((abs(value) for value in known), default=1.0) or 1.0
    axis = make_axis(values, bands, 0.05 * size)
    shapes = list[tuple[str, str]]()
    for each in sides:
        x, kind = np.round(UNITS * across(each.line_x, span)), each.side or "both"
        shapes.append((f"band {kind}", _band(x, axis.down(each.low), axis.down(each.high), each)))
        shapes.append((f"line {kind} thick", _path(x, axis.down(each.line_y))))
    for each in sides:
        x, kind = np.round(UNITS * across(each.x, span)) + (APART if each.side == "right" else 0), each.side or "both"
        shapes.append((f"bar {kind}", _bars(x, axis.down(each.y - each.reach), axis.down(each.y + each.reach), each)))
        dots = "".join(f"M{a:.0f} {b:.0f}h0" for a, b in zip(x, axis.down(each.y), strict=True))
        shapes.append((f"dot {kind}", dots))
    sided = [each for each in sides if each.side]
    rising = [np.ones(len(each.line_y), dtype=bool) for each in sided]
    lines = [Envelope(each.line_y, each.line_y, up) for each, up in zip(sided, rising, strict=True)]
    ends = end_marks([each.side for each in sided], lines, axis, HEIGHT)
    return Row(label=label, height=HEIGHT, shapes=tuple(shapes), axis=axis, marks=ends, kind="curves")


def _path(x: np.ndarray, y: np.ndarray) -> str:
    return "M" + "L".join(f"{a:.0f} {b:.0f}" for a, b in zip(x, y, strict=True)) if len(x) else ""


def _band(x: np.ndarray, low: np.ndarray, high: np.ndarray, side: Drawn) -> str:
    known = np.isfinite(side.low) & np.isfinite(side.high)
    if known.sum() < 2:
        return ""
    there, back = _path(x[known], high[known]), _path(x[known][::-1], low[known][::-1])
    return f"{there}L{back[1:]}z"


def _bars(x: np.ndarray, low: np.ndarray, high: np.ndarray, side: Drawn) -> str:
    known = np.isfinite(side.reach)
    return "".join(f"M{a:.0f} {b:.0f}V{c:.0f}" for a, b, c in zip(x[known], high[known], low[known], strict=True))
