"""Curves of a quantity over time, left and right in one picture, with what each is worth.

A thick line was seen and a thin one inferred; left is unbroken and right is dashed, and both are named at their ends;
the band holds the truth 95 times in 100. Where a group of frames is drawn as one, the line runs in the middle of its
lowest and highest value, and a darker band reaches from the one to the other. Below stand, for each curve, columns of
half the height where it was inferred and of all of it where it is lost. Colour repeats what these say, so that nothing
is lost without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anchorpose.joints import JointState
from anchorpose.report.axis import UNITS, Axis, make_axis
from anchorpose.report.bins import Bins, Envelope, envelope, worst
from anchorpose.report.chart import Column, Reading, Row, cells
from anchorpose.report.paths import band_path, line_paths, step_path
from anchorpose.report.words import COVERAGE, STATE_WORDS, escape
from anchorpose.results.joint_frame import LOST

LETTER_PX = 13  # the height of a curve's name

_STATES = tuple(STATE_WORDS[state] for state in JointState)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """One quantity. value, sigma (n,) float64, NaN where lost; severity (n,). side: left, right or empty.

    key: the beginning of its columns' names in the CSV.
    """

    key: str
    side: str
    value: np.ndarray
    sigma: np.ndarray
    severity: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """What the curves of one picture have in common: name, unit in text and in column names, decimals, least height."""

    label: str
    unit: str
    unit_name: str
    decimals: int
    least_span: float


def curve_rows(curves: Sequence[Curve], quantity: Quantity, bins: Bins, height: int) -> list[Row]:
    """The picture of the curves in one system of axes."""
    lines = [envelope(curve.value, bins) for curve in curves]
    bands = [_band(curve, bins) for curve in curves]
    axis = make_axis([(e.low, e.high) for e in lines], bands, quantity.least_span)
    drawn = zip(curves, lines, bands, strict=True)
    shapes = "".join(_shapes(curve, line, band, bins, axis) for curve, line, band in drawn)
    ends = "" if len(curves) < 2 else _ends([curve.side for curve in curves], lines, axis, height)
    return [Row(label=escape(quantity.label), height=height, shapes=shapes, axis=axis, marks=ends, kind="curves")]


def state_rows(curves: Sequence[Curve], bins: Bins) -> list[Row]:
    """One low row a curve: where it was inferred or lost; none where all was seen throughout."""
    rows = []
    for curve in curves:
        state = worst(curve.severity, bins)
        if (state > 0).any():
            level = np.where(state == LOST, 1.0, np.where(state > 0, 0.5, 0.0))
            lost, inferred = step_path(np.where(level == 1.0, 1.0, 0.0), bins), step_path(level * (level < 1), bins)
            shapes = f"<path class='inferred' d='{inferred}'/><path class='lost' d='{lost}'/>"
            label = f"{curve.side or 'not'}{' not' if curve.side else ''} seen"
            rows.append(Row(label=label, height=12, shapes=shapes, kind="state"))
    return rows


def readings(curve: Curve, quantity: Quantity, bins: Bins, label: str, with_state: bool = True) -> Reading:
    """What the slider says of a curve; one state does for several curves of a joint."""
    line, name = envelope(curve.value, bins), f"{curve.key}_{{}}_{quantity.unit_name}"
    sigma = np.fmax.reduceat(curve.sigma, bins.start)
    states = [_STATES[code] for code in worst(curve.severity, bins)]
    return Reading(
        label=label,
        unit=quantity.unit,
        low=Column(name.format("lowest"), cells(line.low, quantity.decimals)),
        high=Column(name.format("highest"), cells(line.high, quantity.decimals)),
        sigma=Column(name.format("sigma"), cells(sigma, quantity.decimals + 1)) if with_state else None,
        state=Column(f"{curve.key}_state", [state.replace(",", ";") for state in states]) if with_state else None,
    )


def _band(curve: Curve, bins: Bins) -> tuple[np.ndarray, np.ndarray]:
    reach = COVERAGE * curve.sigma
    return envelope(curve.value - reach, bins).low, envelope(curve.value + reach, bins).high


def _shapes(curve: Curve, line: Envelope, band: tuple[np.ndarray, np.ndarray], bins: Bins, axis: Axis) -> str:
    middle = (line.low + line.high) / 2.0
    seen, inferred = line_paths(Envelope(middle, middle, line.rising), worst(curve.severity, bins) == 0, bins, axis)
    side = curve.side or "both"
    spread = f"<path class='spread {side}' d='{band_path(line.low, line.high, bins, axis)}'/>" if bins.thinned else ""
    return (
        f"<path class='band {side}' d='{band_path(*band, bins, axis)}'/>{spread}"
        f"<path class='line {side} thin' d='{inferred}'/><path class='line {side} thick' d='{seen}'/>"
    )


def _ends(sides: Sequence[str], lines: Sequence[Envelope], axis: Axis, height: int) -> str:
    """The names of the curves beside their last value, pushed apart where they would meet."""
    known = [(side, line.high[np.isfinite(line.high)]) for side, line in zip(sides, lines, strict=True)]
    places = sorted((float(axis.down(values[-1:])[0]) / UNITS, side) for side, values in known if len(values))
    if len(places) == 2 and places[1][0] - places[0][0] < LETTER_PX / height:
        middle, half = (places[0][0] + places[1][0]) / 2.0, LETTER_PX / height / 2.0
        places = [(middle - half, places[0][1]), (middle + half, places[1][1])]
    return "".join(
        f"<span class='end {side}' style='top:{100 * place:.1f}%' aria-hidden='true'>{side[:1].upper()}</span>"
        for place, side in places
    )
