"""Plots of agreement as SVG that needs no script: differences against means, and both systems over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from markupsafe import Markup

from anchorpose.agreement.rows import Agreement, Compared
from anchorpose.report.chart import Axis, make_axis

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
