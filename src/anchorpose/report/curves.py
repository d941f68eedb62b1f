"""Draw curves of a quantity over time, left and right in one picture, as SVG paths with whole numbers.

A line is thick where the quantity was seen and thin where it was inferred. The line of the left side is solid, that of
the right side dashed, and each curve has a letter at its end. The band around a line is ± 1.96 sigma. Where a group of
frames is drawn as one point, the line runs midway between the group's lowest and highest value, and a darker band
reaches from the lowest to the highest value. Below the picture, each curve whose quantity was not seen in all
frames has a row of columns: a column of half height means that the quantity was inferred, a column of full height that
the quantity is lost. No information depends on colour alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.joints import LOST, JointState
from anchorpose.report.chart import (
    UNITS,
    Axis,
    Bins,
    Column,
    Envelope,
    Mark,
    Reading,
    Row,
    cells,
    envelope,
    lowest_and_highest,
    make_axis,
    worst,
)
from anchorpose.report.words import STATE_WORDS
from anchorpose.results.frame_time import runs_of
from anchorpose.results.uncertainty import NORMAL_95

LETTER_PX: Final = 13  # height of the letter that marks a curve at its end

_STATES: Final = tuple(STATE_WORDS[state] for state in JointState)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """A curve of one quantity. value, sigma (n,) float64, NaN where lost; state_code (n,). side: left, right or empty.

    key: the text with which the names of the curve's columns in the CSV begin.
    """

    key: str
    side: str
    value: np.ndarray
    sigma: np.ndarray
    state_code: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """The properties that all curves in a picture share: name, unit as written in texts and in column names, number of
    decimals, and minimum range of the axis.
    """

    label: str
    unit: str
    unit_name: str
    decimals: int
    least_span: float


def curve_row(curves: Sequence[Curve], quantity: Quantity, bins: Bins, height: int) -> Row:
    """Return one picture with all curves, on common axes."""
    lines = [envelope(curve.value, bins) for curve in curves]
    bands = [_band(curve, bins) for curve in curves]
    axis = make_axis([(e.low, e.high) for e in lines], bands, quantity.least_span)
    drawn = zip(curves, lines, bands, strict=True)
    shapes = [shape for curve, line, band in drawn for shape in _shapes(curve, line, band, bins, axis)]
    ends = () if len(curves) < 2 else end_marks([curve.side for curve in curves], lines, axis, height)
    return Row(label=quantity.label, height=height, shapes=tuple(shapes), axis=axis, marks=ends, kind="curves")


def state_rows(curves: Sequence[Curve], bins: Bins) -> list[Row]:
    """Return one row of small height for each curve whose quantity was not seen in all frames; the row shows where the
    quantity was inferred or lost.
    """
    rows = []
    for curve in curves:
        state = worst(curve.state_code, bins)
        if (state > 0).any():
            inferred = np.where((state > 0) & (state != LOST), 0.5, 0.0)
            lost = np.where(state == LOST, 1.0, 0.0)
            shapes = (("inferred", step_path(inferred, bins)), ("lost", step_path(lost, bins)))
            label = f"{curve.side or 'not'}{' not' if curve.side else ''} seen"
            rows.append(Row(label=label, height=12, shapes=shapes, kind="state"))
    return rows


def readings(curve: Curve, quantity: Quantity, bins: Bins, label: str, with_state: bool = True) -> Reading:
    """Return the curve's values that the page's slider shows at the chosen time. with_state: whether to include sigma
    and state. The x, y and z curves of a joint's path share sigma and state, so only one of the three includes them.
    """
    name = f"{curve.key}_{{}}_{quantity.unit_name}"
    columns = lowest_and_highest(name, curve.value, bins, quantity.decimals)
    if with_state:
        sigma, states = np.fmax.reduceat(curve.sigma, bins.start), worst(curve.state_code, bins)
        columns["sigma"] = Column(name.format("sigma"), cells(sigma, quantity.decimals + 1))
        columns["state"] = Column(f"{curve.key}_state", [_STATES[code].replace(",", ";") for code in states])
    return Reading(label=label, unit=quantity.unit, columns=columns)


def _band(curve: Curve, bins: Bins) -> tuple[np.ndarray, np.ndarray]:
    reach = NORMAL_95 * curve.sigma
    return envelope(curve.value - reach, bins).low, envelope(curve.value + reach, bins).high


def _shapes(
    curve: Curve, line: Envelope, band: tuple[np.ndarray, np.ndarray], bins: Bins, axis: Axis
) -> list[tuple[str, str]]:
    """Return a curve's shapes in the order of drawing: uncertainty band, band from lowest to highest value, line."""
    middle = (line.low + line.high) / 2.0
    seen, inferred = line_paths(Envelope(middle, middle, line.rising), worst(curve.state_code, bins) == 0, bins, axis)
    side = curve.side or "both"
    spread = [(f"spread {side}", band_path(line.low, line.high, bins, axis))] if bins.thinned else []
    lines = [(f"line {side} thin", inferred), (f"line {side} thick", seen)]
    return [(f"band {side}", band_path(*band, bins, axis)), *spread, *lines]


def end_marks(sides: Sequence[str], lines: Sequence[Envelope], axis: Axis, height: int) -> tuple[Mark, ...]:
    """Return the letters L and R, each beside the last value of its curve. Letters that would overlap are moved
    apart.
    """
    known = [(side, line.high[np.isfinite(line.high)]) for side, line in zip(sides, lines, strict=True)]
    places = sorted((float(axis.down(values[-1:])[0]) / UNITS, side) for side, values in known if len(values))
    if len(places) == 2 and places[1][0] - places[0][0] < LETTER_PX / height:
        middle, half = (places[0][0] + places[1][0]) / 2.0, LETTER_PX / height / 2.0
        places = [(middle - half, places[0][1]), (middle + half, places[1][1])]
    return tuple(
        Mark(text=side[:1].upper(), kind=f"end {side}", style=f"top:{100 * place:.1f}%") for place, side in places
    )


Points = list[tuple[int, int]]


def line_paths(curve: Envelope, seen: np.ndarray, bins: Bins, axis: Axis) -> tuple[str, str]:
    """Return two SVG paths: the line segments between neighbouring groups of frames that are both ``seen`` (b,), and
    all other segments. No line is drawn across a pause or a group without a value.
    """
    finite, across = np.isfinite(curve.low), _across(bins.place)
    low, high = (_whole(axis.down(np.where(finite, edge, axis.low))) for edge in (curve.low, curve.high))
    ends = [(a, b) if rises else (b, a) for a, b, rises in zip(low, high, curve.rising.tolist(), strict=True)]
    paths: dict[bool, list[str]] = {True: [], False: []}
    for run in _runs(finite, bins):
        for piece, kind in _same_kind(seen, run):
            groups = range(piece.start, piece.stop)
            paths[kind].append(_trace([(across[k], y) for k in groups for y in dict.fromkeys(ends[k])]))
    return "".join(paths[True]), "".join(paths[False])


def band_path(low: np.ndarray, high: np.ndarray, bins: Bins, axis: Axis) -> str:
    """Return the area between two curves (b,) as an SVG path: an outline for each run of groups of frames in which all
    groups have values, without a pause.
    """
    across, finite = _across(bins.place), np.isfinite(low) & np.isfinite(high)
    top, bottom = (_whole(axis.down(np.where(finite, edge, axis.low))) for edge in (high, low))
    outlines = []
    for run in _runs(finite, bins):
        group = range(run.start, run.stop)
        outline = [(across[k], top[k]) for k in group] + [(across[k], bottom[k]) for k in reversed(group)]
        outlines.append(_trace(outline) + "z")
    return "".join(outlines)


def step_path(level: np.ndarray, bins: Bins) -> str:
    """Return an SVG path with one column per group of frames, as wide as the group; ``level`` (b,): the columns'
    heights as shares of the full height; 0 draws nothing.
    """
    place, height = bins.place, np.array(_across(np.nan_to_num(level)))  # a group without a value draws nothing
    # Columns of neighbouring groups meet midway between the groups, except beside a pause
    middle = (place[1:] + place[:-1]) / 2.0
    left = _across(np.append(0.0, np.where(bins.after_pause[1:], place[1:], middle)))
    right = _across(np.append(np.where(bins.after_pause[1:], place[:-1], middle), 1.0))
    parts = []
    for run in runs_of(height > 0, (height[1:] == height[:-1]) & ~bins.after_pause[1:]):
        begin, tall = left[run.start], height[run.start]
        parts.append(f"M{begin} {UNITS}v{-tall}h{max(1, right[run.stop - 1] - begin)}v{tall}z")
    return "".join(parts)


def _across(share: np.ndarray) -> list[int]:
    """Convert shares of a picture's width or height to whole units of the drawing (``UNITS`` for the full width or
    height).
    """
    return _whole(np.round(UNITS * share))


def _whole(values: np.ndarray) -> list[int]:
    return [int(value) for value in values]


def _runs(known: np.ndarray, bins: Bins) -> list[slice]:
    """Return each run of neighbouring groups of frames in which ``known`` (b,) is True for all groups, without a pause
    between them.
    """
    return runs_of(known, ~bins.after_pause[1:])


def _same_kind(seen: np.ndarray, run: slice) -> list[tuple[slice, bool]]:
    """Split a run of groups of frames into pieces in which the line segments (from each group to the next) are all
    seen, or all unseen; neighbouring pieces share a group. A line segment is seen if the groups at both its ends are
    seen.
    """
    if run.stop - run.start == 1:
        return [(run, bool(seen[run.start]))]
    link = seen[run.start : run.stop - 1] & seen[run.start + 1 : run.stop]
    pieces = runs_of(np.ones(len(link), dtype=bool), link[1:] == link[:-1])
    return [(slice(run.start + one.start, run.start + one.stop + 1), bool(link[one.start])) for one in pieces]


def _trace(points: Points) -> str:
    """Return an SVG path of relative steps, which are shorter to write than coordinates. A single point becomes a step
    of length zero: a dot.
    """
    x, y = points[0]
    steps = [f"M{x} {y}l"]
    for next_x, next_y in points[1:] or points:
        steps.append(f"{next_x - x} {next_y - y}")
        x, y = next_x, next_y
    return steps[0] + " ".join(steps[1:])
