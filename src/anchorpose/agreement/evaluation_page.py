"""Write agreement.html: the main numbers of a comparison, their plots, and how they were found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from markupsafe import Markup

from anchorpose.agreement.evaluating import Comparison
from anchorpose.agreement.rows import ALL, AS_MEASURED, INFERRED, Agreement, Compared, quantities
from anchorpose.joints import JointState
from anchorpose.report.chart import Axis, make_axis
from anchorpose.results.web_page import render_page

SHOWN_STATES: Final = (ALL, str(JointState.OBSERVED), INFERRED)

DIFFERENCE_HEAD: Final = (
    "",
    "bias (95 %)",
    "limits of agreement (95 % of each)",
    "RMSE",
    "largest",
    "CMC",
    "range, ours / theirs",
    "within 1.96 σ",
    "calibration error",
)
DISTANCE_HEAD: Final = ("", "mean, mm", "RMSE, mm", "largest, mm", "samples")


def page_text(comparison: Comparison, alignments: Sequence[Sequence[str]], methods: Sequence[str]) -> str:
    """The page; alignments: sentences per recording."""
    rows = comparison.rows
    named = [f"{match.results.name} against {match.reference.path.name}" for match in comparison.matches]
    return render_page(
        "anchorpose.agreement",
        "templates/agreement.html",
        title="Agreement with another system",
        recordings=list(zip(named, alignments, strict=True)),
        notes=[note for match in comparison.matches for note in match.reference.notes],
        distance_head=DISTANCE_HEAD,
        distances=distance_rows(comparison),
        difference_head=DIFFERENCE_HEAD,
        differences=angle_rows(comparison),
        joints=[_difference_cells(row) for row in rows if _joint_row(row)],
        plots=_plots(comparison),
        methods=methods,
    )


def distance_rows(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """(title, cells of ``DISTANCE_HEAD``) of joints and of all of them."""
    return [_distance_cells(row) for row in comparison.rows if row.axis == "distance" and row.state in SHOWN_STATES]


def angle_rows(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """(title, cells of ``DIFFERENCE_HEAD``) of angles."""
    return [_difference_cells(row) for row in comparison.rows if row.kind != "joint" and row.state in SHOWN_STATES]


def _joint_row(row: Agreement) -> bool:
    return row.kind == "joint" and row.axis != "distance" and row.state == ALL


def _title(row: Agreement) -> str:
    axis = "" if row.axis in ("distance", "degrees") else f", {row.axis}"
    given = ", as the other system gives it" if row.kind == "given_angle" else ""
    removed = "" if row.offset == AS_MEASURED else ", offset removed"
    return f"{row.name.replace('_', ' ')}{axis}{given} ({row.state}{removed})"


def _distance_cells(row: Agreement) -> tuple[str, list[str]]:
    return _title(row), [f"{row.mean_abs:.1f}", f"{row.rmse:.1f}", f"{row.largest:.0f}", str(row.samples)]


def _difference_cells(row: Agreement) -> tuple[str, list[str]]:
    limits = f"{_number(row.lower)} to {_number(row.upper)}"
    if row.lower_low is not None:
        limits += (
            f" ({_number(row.lower_low)} to {_number(row.lower_high)}; "
            f"{_number(row.upper_low)} to {_number(row.upper_high)})"
        )
    bias = _number(row.bias)
    if row.bias_low is not None:
        bias += f" ({_number(row.bias_low)} to {_number(row.bias_high)})"
    return _title(row), [
        f"{bias} {row.unit}",
        limits,
        _number(row.rmse),
        _number(row.largest),
        _number(row.cmc, 3),
        f"{_number(row.range_ours)} / {_number(row.range_theirs)}",
        "–" if row.coverage_95 is None else f"{100 * row.coverage_95:.0f} %",
        _number(row.calibration_error, 2),
    ]


def _number(value: float | None, digits: int = 1) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _plots(comparison: Comparison) -> list[tuple[str, list[Markup]]]:
    """Of each angle: differences against means of all recordings, and the first recording over time."""
    chosen = {
        (row.kind, row.name): row
        for row in comparison.rows
        if row.kind != "joint" and row.state == ALL and row.offset == AS_MEASURED
    }
    found = []
    for quantity in quantities(comparison.matches):
        row = chosen.get((quantity.kind, quantity.name))
        if row is not None:
            series = [each for each in map(quantity.take, comparison.matches) if each is not None]
            pictures = [difference_plot(series, row), time_plot(series[0], row.name, row.unit)]
            found.append((_title(row), pictures))
    return found


WIDTH, HEIGHT = 420, 240
LEFT, BOTTOM, TOP, RIGHT = 52, 34, 10, 12
MOST_POINTS: Final = 400
"""Of a recording; more would only darken the same cloud."""


def difference_plot(series: Sequence[Compared], row: Agreement) -> Markup:
    """Difference against mean of both systems, with bias and limits (Bland and Altman); a point per frame, thinned."""
    means, differences, inferred = (np.concatenate(each) for each in zip(*map(_cloud, series), strict=True))
    lines = [value for value in (row.bias, row.lower, row.upper) if value is not None]
    across = make_axis([(means, means)], [], 1e-6)
    up = make_axis([(np.append(differences, lines), np.append(differences, lines))], [], 1e-6)
    x, y = _along(across, means), _down(up, differences)
    shapes = [
        f'<circle class="{"inferred" if hidden else "seen"}" cx="{a:.0f}" cy="{b:.0f}" r="1.6"/>'
        for a, b, hidden in zip(x, y, inferred, strict=True)
    ]
    for kind, value in (("bias", row.bias), ("limit", row.lower), ("limit", row.upper)):
        if value is not None:
            height = float(_down(up, np.array(value)))
            shapes.append(f'<path class="{kind}" d="M{LEFT} {height:.1f}H{WIDTH - RIGHT}"/>')
    title = f"{row.name}: ours minus theirs against the mean, {row.unit}"
    return _picture(title, across, up, "".join(shapes), (f"mean, {row.unit}", f"ours − theirs, {row.unit}"))


def time_plot(each: Compared, name: str, unit: str) -> Markup:
    """Ours, with a band of 1.96 sigma, and theirs over time."""
    every = max(1, len(each.time_s) // MOST_POINTS)
    time_s, ours, theirs, sigma = (a[::every] for a in (each.time_s, each.ours, each.theirs, each.sigma))
    across = make_axis([(time_s, time_s)], [], 1.0)
    up = make_axis([(ours, ours), (theirs, theirs)], [(ours - 1.96 * sigma, ours + 1.96 * sigma)], 1e-6)
    x = _along(across, time_s)
    shapes = [
        f'<path class="sigma" d="{_band(x, _down(up, ours - 1.96 * sigma), _down(up, ours + 1.96 * sigma))}"/>',
        f'<path class="theirs" d="{_line(x, _down(up, theirs))}"/>',
        f'<path class="ours" d="{_line(x, _down(up, ours))}"/>',
    ]
    return _picture(f"{name} over time, both systems, {unit}", across, up, "".join(shapes), ("time, s", unit))


def _cloud(each: Compared) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    known = np.flatnonzero(np.isfinite(each.ours + each.theirs))
    rows = known[:: max(1, len(known) // MOST_POINTS)]
    ours, theirs = each.ours[rows], each.theirs[rows]
    return 0.5 * (ours + theirs), ours - theirs, each.state_code[rows] > 0


def _along(axis: Axis, value: np.ndarray) -> np.ndarray:
    return LEFT + (WIDTH - LEFT - RIGHT) * (value - axis.low) / (axis.high - axis.low)


def _down(axis: Axis, value: np.ndarray) -> np.ndarray:
    return TOP + (HEIGHT - TOP - BOTTOM) * np.clip((axis.high - value) / (axis.high - axis.low), -0.1, 1.1)


def _line(x: np.ndarray, y: np.ndarray) -> str:
    """A path that is broken where a value is missing."""
    parts, pen = list[str](), False
    for a, b in zip(x, y, strict=True):
        if np.isfinite(b):
            parts.append(f"{'L' if pen else 'M'}{a:.1f} {b:.1f}")
        pen = bool(np.isfinite(b))
    return "".join(parts)


def _band(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> str:
    known = np.isfinite(low) & np.isfinite(high)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]])))
    paths = []
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        there = [f"{a:.1f} {b:.1f}" for a, b in zip(x[first:end], low[first:end], strict=True)]
        back = [f"{a:.1f} {b:.1f}" for a, b in zip(x[first:end][::-1], high[first:end][::-1], strict=True)]
        paths.append("M" + "L".join([*there, *back]) + "Z")
    return "".join(paths)


def _picture(title: str, across: Axis, up: Axis, shapes: str, words: tuple[str, str]) -> Markup:
    base, end = HEIGHT - BOTTOM, WIDTH - RIGHT
    ticks = [
        f'<text x="{LEFT - 5}" y="{TOP + (base - TOP) * share + 4:.1f}" text-anchor="end">{text}</text>'
        f'<path class="grid" d="M{LEFT} {TOP + (base - TOP) * share:.1f}H{end}"/>'
        for share, text in up.labels()
    ]
    ticks += [
        f'<text x="{end - (end - LEFT) * share:.1f}" y="{base + 14}" text-anchor="middle">{text}</text>'
        for share, text in across.labels()
    ]
    names = (
        f'<text x="{(LEFT + end) / 2:.0f}" y="{HEIGHT - 4}" text-anchor="middle">{words[0]}</text>'
        f'<text transform="translate(11 {(TOP + base) / 2:.0f}) rotate(-90)" text-anchor="middle">{words[1]}</text>'
    )
    return Markup(
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{{}}">{"".join(ticks)}{shapes}{names}</svg>'
    ).format(title)
