"""Provide the common style of all figures: colours, and line styles and marks that distinguish methods even without
colour.

The same tables always give the same bytes of a figure.
"""

from __future__ import annotations

import importlib
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from anchorpose.errors import MissingPackage
from anchorpose.pages.canvas import Ink, as_hex
from anchorpose.research.experiment.method import PROPOSED, Family, Method
from anchorpose.research.experiment.page.tables import Estimate, Table

DPI: Final = 120
INK: Final = "#15191d"
FAINT: Final = "#8a9299"
LINE: Final = "#d5dbe0"
GROUND: Final = "#ffffff"
# colour of text on dark cells; it is not GROUND, since the page in dark colours replaces GROUND by a dark colour
ON_DARK: Final = "#fefefe"

LOOK: Final = {
    Family.PROPOSED: (as_hex(Ink.VERMILLION), "solid"),
    Family.LOCAL: (as_hex(Ink.BLUE), (0, (5, 1.5))),
    Family.SPECTRAL: (as_hex(Ink.GREEN), (0, (1, 1.2))),
    Family.MESH: (as_hex(Ink.PURPLE), (0, (5, 1.5, 1, 1.5))),
    Family.GLOBAL: (as_hex(Ink.ORANGE), (0, (8, 2))),
    Family.LEARNT: (as_hex(Ink.SKY), (0, (3, 1))),
    Family.NONE: (FAINT, (0, (2, 2))),
    Family.TRACKER: (INK, "solid"),
}
"""Colour, mostly from Okabe and Ito's palette, and line style of each family of methods."""

PALE: Final = 0.35  # opacity (0 to 1) of confidence intervals, so low that the intervals of 20 methods hide no means

MARKS: Final = "osD^vP*X"
"""Matplotlib's markers for the methods of one family, in the order of the methods."""

FAMILY_NAMES: Final = {
    Family.PROPOSED: "anchor geodesics",
    Family.LOCAL: "local",
    Family.SPECTRAL: "spectral",
    Family.MESH: "on the mesh",
    Family.GLOBAL: "global",
    Family.LEARNT: "learnt",
    Family.NONE: "no feature",
    Family.TRACKER: "anchorpose",
}


@dataclass(frozen=True, slots=True)
class DrawnFigure:
    """A figure drawn from tables, as SVG and PNG."""

    key: str  # name of the figure's files
    caption: str  # caption, with the figure's name in the paper
    svg: str
    png_bytes: bytes


@dataclass(frozen=True, slots=True)
class FigureSpec:
    """A figure to be drawn from tables."""

    key: str
    caption: str
    tables: tuple[str, ...]  # keys of the tables that the figure needs
    # function that draws the figure from its tables, even if the tables lack some methods
    draw: Callable[[Sequence[Table]], Any]


def new_figure(width: float, height: float, **grid: Any) -> tuple[Any, Any]:
    """Return a figure (size in inches) and its axes, without pyplot's global state. Raises MissingPackage."""
    canvas = _matplotlib("matplotlib.figure").Figure(figsize=(width, height), layout="constrained")
    return canvas, canvas.subplots(**grid)


def as_picture(figure: FigureSpec, tables: Sequence[Table]) -> DrawnFigure:
    """Draw the figure from its tables as SVG and PNG; the same tables give the same bytes."""
    with _settings(figure.key):
        canvas = figure.draw(tables)
        svg, png = io.StringIO(), io.BytesIO()
        canvas.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
        canvas.savefig(png, format="png", dpi=DPI, metadata={"Software": None})
    return DrawnFigure(figure.key, figure.caption, svg.getvalue(), png.getvalue())


def _matplotlib(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise MissingPackage("drawing the experiment's figures", "matplotlib", "experiments") from None


def _settings(salt: str) -> Any:
    mpl = _matplotlib("matplotlib")
    plain: dict[str, Any] = dict(mpl.rcParamsDefault)
    plain.pop("backend", None)  # removes the setting of the backend, since no window is opened
    plain.pop("backend_fallback", None)
    plain |= {
        "svg.hashsalt": f"anchorpose {salt}",
        "svg.fonttype": "none",
        "font.size": 9.0,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.color": LINE,
        "grid.linewidth": 0.6,
        "axes.edgecolor": FAINT,
        "axes.labelcolor": INK,
        "text.color": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "axes.axisbelow": True,
        "axes.titlesize": 9.5,
        "axes.titlelocation": "left",
        "legend.frameon": False,
        "legend.fontsize": 8.0,
        "text.parse_math": False,
    }
    return mpl.rc_context(plain)


def look_of(method: Method, methods: Sequence[Method]) -> dict[str, Any]:
    """Return matplotlib's style of a method: its own mark, and the colour and line style of its family.

    The proposed method and this project's tracker have thick lines and filled marks.
    """
    colour, line = LOOK[method.family]
    alike = [one.key for one in methods if one.family is method.family]
    strong = method.key == PROPOSED or method.family is Family.TRACKER
    return {
        "color": colour,
        "linestyle": line,
        "marker": MARKS[alike.index(method.key) % len(MARKS)],
        "markersize": 4.5,
        "linewidth": 2.2 if strong else 1.2,
        "zorder": 4 if strong else 3,
        "markerfacecolor": colour if strong else GROUND,
        "markeredgecolor": colour,
    }


def bounds_of(values: Sequence[Estimate]) -> np.ndarray:
    """Return (2, n): distances from each mean to the lower and the upper end of its interval; 0 without an interval."""
    below = [value.mean - value.low for value in values]
    above = [value.high - value.mean for value in values]
    return np.maximum(np.nan_to_num(np.array([below, above])), 0.0)


def place_legend(canvas: Any, axes: Any) -> None:
    """Place the legend beside the plot, in one column."""
    handles, labels = axes.get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside right upper", handlelength=3.2)


def draw_lines(axes: Any, table: Table, places: Sequence[float], bars: bool = True) -> None:
    """Draw one line per method over the columns of a table. places: x of each column. bars: also draw the intervals."""
    for number, method in enumerate(table.methods):
        values = [table.value(method.key, column.key) for column in table.columns]
        look = look_of(method, table.methods)
        means = [value.mean for value in values]
        if bars:
            step = 0.8 * (np.diff(sorted(places)).min() if len(places) > 1 else 1.0) / len(table.methods)
            shifted = np.asarray(places) + step * (number - (len(table.methods) - 1) / 2)
            pale = (look["color"], PALE)
            axes.errorbar(
                shifted, means, yerr=bounds_of(values), label=method.title, elinewidth=0.7, ecolor=pale, **look
            )
        else:
            axes.plot(places, means, label=method.title, markevery=5, **look)
    axes.set_ylim(0, 1.05 * axes.get_ylim()[1])


def draw_dots(axes: Any, table: Table, column: str, methods: Sequence[Method], **change: Any) -> None:
    """Draw a row per method: a dot (the mean) with its interval. change: entries that replace entries of
    ``look_of``.
    """
    for row, method in enumerate(methods):
        value = table.value(method.key, column)
        if np.isnan(value.mean):
            continue
        look = look_of(method, methods) | {"linestyle": "none"} | change
        shift = look.pop("shift", 0.0)
        axes.errorbar([value.mean], [row + shift], xerr=bounds_of([value]), elinewidth=1.2, **look)


def name_rows(axes: Any, methods: Sequence[Method]) -> None:
    """Write the titles of the methods as the labels of the rows, the first on top."""
    axes.set_yticks(range(len(methods)), [method.title for method in methods])
    axes.set_ylim(len(methods) - 0.5, -0.5)


def draw_heat(axes: Any, table: Table, most: float, text: Callable[[float], str]) -> Any:
    """Draw a table as coloured cells, a row per method, with numbers. most: value at the end of the colour scale."""
    columns, methods = table.columns, table.methods
    values = np.array([[table.value(m.key, c.key).mean for c in columns] for m in methods])
    image = axes.imshow(np.ma.masked_invalid(values), cmap="cividis", vmin=0, vmax=most, aspect="auto")
    axes.grid(visible=False)
    axes.set_xticks(range(len(columns)), [column.label for column in columns], rotation=40, ha="right")
    axes.set_yticks(range(len(methods)), [method.title for method in methods])
    for row, column in np.ndindex(*values.shape):
        value = values[row, column]
        ink = ON_DARK if value < most / 2 else "black"
        label = "–" if np.isnan(value) else text(float(value))
        axes.text(column, row, label, ha="center", va="center", fontsize=7.5, color=INK if np.isnan(value) else ink)
    return image


def most_of(table: Table) -> float:
    """Return the largest mean of a table, as the end of an axis or colour scale; 1 if it has no mean or only zeros."""
    means = [row.value.mean for row in table.rows if np.isfinite(row.value.mean)]
    return max(means, default=1.0) or 1.0
