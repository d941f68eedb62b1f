"""Define all figures in the order of the page: the paper's figures "result1", "sd1", "result2", "sd2" and others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from anchorpose.research.experiment.method import PROPOSED, Family
from anchorpose.research.experiment.page.drawing import (
    FAINT,
    FAMILY_NAMES,
    DrawnFigure,
    FigureSpec,
    as_picture,
    draw_dots,
    draw_heat,
    draw_lines,
    look_of,
    most_of,
    name_rows,
    new_figure,
    place_legend,
)
from anchorpose.research.experiment.page.matching_tables import PAPER_FEATURE_S
from anchorpose.research.experiment.page.tables import Table, Unit
from anchorpose.research.experiment.page.tracking_claims import CONSTANT
from anchorpose.research.experiment.page.tracking_tables import OTHER_HOLES

PANELS = (
    (Family.PROPOSED,),
    (Family.LOCAL,),
    (Family.SPECTRAL,),
    (Family.MESH, Family.GLOBAL),
    (Family.NONE, Family.TRACKER),
)


def _draw_by_joint(tables: Sequence[Table], what: str) -> Any:
    """Draw each joint's error by every method, in one panel per group of families of methods (``PANELS``). Every panel
    also shows the proposed method.
    """
    table = tables[0]
    present = {method.family for method in table.methods}
    panels = [panel for panel in PANELS if present & set(panel)]
    canvas, grid = new_figure(8.2, 1.75 * len(panels) + 0.9, nrows=len(panels), sharex=True, sharey=True, squeeze=False)
    joints = table.columns
    for axes, families in zip(grid[:, 0], panels, strict=True):
        for method in table.methods:
            if method.family not in families and method.key != PROPOSED:
                continue
            values = [table.value(method.key, joint.key).mean for joint in joints]
            axes.plot(np.arange(len(joints)), values, label=method.title, **look_of(method, table.methods))
        axes.set_title(", ".join(FAMILY_NAMES[family] for family in families if family in present))
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), handlelength=3.2)
    grid[0, 0].set_ylim(0, 1.05 * most_of(table))
    grid[-1, 0].set_xticks(range(len(joints)), [joint.label for joint in joints], rotation=55, ha="right")
    canvas.supylabel(what, fontsize=9)
    return canvas


NOTE = "All sizes of hole together, every method on the same frames. The proposed method is drawn in every panel."

RESULT2 = FigureSpec(
    "result2",
    f"The paper’s “result2”: mean error of each joint (r_i). {NOTE}",
    ("result2",),
    lambda tables: _draw_by_joint(tables, "mean error (mm)"),
)
SD2 = FigureSpec(
    "sd2",
    f"The paper’s “sd2”: standard deviation of each joint’s error. {NOTE}",
    ("sd2",),
    lambda tables: _draw_by_joint(tables, "standard deviation (mm)"),
)
BY_JOINT_FIGURES = (RESULT2, SD2)


SAME = "Every method on the same frames; bars: 95 % confidence intervals."


def _draw_by_size(tables: Sequence[Table], what: str) -> Any:
    table = tables[0]
    canvas, axes = new_figure(8.2, 4.6)
    places = [float(column.key) for column in table.columns]
    draw_lines(axes, table, places)
    axes.set_xticks(places, [column.label for column in table.columns])
    axes.set_xlabel("radius of the hole")
    axes.set_ylabel(what)
    place_legend(canvas, axes)
    return canvas


RESULT1 = FigureSpec(
    "result1",
    f"The paper’s “result1”: mean error of all joints (r_or) by size of hole. {SAME}",
    ("result1",),
    lambda tables: _draw_by_size(tables, "mean joint error (mm)"),
)
SD1 = FigureSpec(
    "sd1",
    f"The paper’s “sd1”: standard deviation over frames of a frame’s mean error, by size of hole. {SAME}",
    ("sd1",),
    lambda tables: _draw_by_size(tables, "standard deviation (mm)"),
)
OTHERS = tuple(
    FigureSpec(
        f"{scene}_by_size",
        f"Beyond the paper: mean error of all joints by size of hole in the scene “{scene}”. {SAME}",
        (f"{scene}_by_size",),
        lambda tables: _draw_by_size(tables, "mean joint error (mm)"),
    )
    for scene in OTHER_HOLES
)
BY_SIZE_FIGURES = (RESULT1, SD1)


def _draw_princeton(tables: Sequence[Table]) -> Any:
    canvas, grid = new_figure(9.6, 4.4, ncols=len(tables), sharey=True, squeeze=False)
    for axes, table in zip(grid[0], tables, strict=True):
        share = table.key.endswith("height")
        draw_lines(axes, table, [float(column.key) * (100 if share else 1) for column in table.columns], bars=False)
        axes.set_xlabel("along the skin (% of height)" if share else "along the skin (mm)")
        axes.set_ylim(0, 1)
    grid[0, 0].set_yticks([0, 0.25, 0.5, 0.75, 1], ["0 %", "25 %", "50 %", "75 %", "100 %"])
    grid[0, 0].set_ylabel("nodes matched within")
    place_legend(canvas, grid[0, 0])
    return canvas


PRINCETON_FIGURES = (
    FigureSpec(
        "princeton",
        "Share of all nodes whose match lies within a distance of its true place, measured along the skin "
        "(Kim et al. 2011, doi:10.1145/2010324.1964974). A node without a match is within none. Direct matches; "
        "matches after the tree for methods without direct ones.",
        ("princeton_mm", "princeton_height"),
        _draw_princeton,
    ),
)


def _draw_ratio(tables: Sequence[Table]) -> Any:
    methods, largest = tables[0].methods, tables[0].columns[-1]
    canvas, grid = new_figure(8.2, 0.27 * len(methods) + 1.2, ncols=2, sharey=True, sharex=True, squeeze=False)
    for axes, table, title in zip(grid[0], tables, ("all frames", "frames with a hole"), strict=True):
        draw_dots(axes, table, largest.key, methods)
        axes.axvline(1.0, color=FAINT, linewidth=1)
        axes.axvline(CONSTANT, color=FAINT, linewidth=1, linestyle=(0, (4, 3)))
        axes.set_title(title)
    name_rows(grid[0, 0], methods)
    canvas.supxlabel(f"error at {largest.label} over that without", fontsize=9)
    return canvas


RATIO_FIGURES = (
    FigureSpec(
        "ratio",
        f"Mean joint error with the largest hole over that without, in the same frames. Dashed: {CONSTANT}, the limit "
        "for “almost constant” in the claims.",
        ("ratio", "ratio_occluded"),
        _draw_ratio,
    ),
)


def _draw_regions(tables: Sequence[Table]) -> Any:
    rows = len(tables[0].methods)
    canvas, grid = new_figure(9.6, 0.27 * rows + 1.5, ncols=2, sharey=True, squeeze=False)
    draw_heat(grid[0, 0], tables[0], most_of(tables[0]), lambda value: f"{value:.0f}")
    grid[0, 0].set_title("median error (mm)")
    draw_heat(grid[0, 1], tables[1], max(0.5, most_of(tables[1])), lambda value: f"{100 * value:.0f}")
    grid[0, 1].set_title("on the other side’s limb (%)")
    return canvas


REGIONS_FIGURES = (
    FigureSpec(
        "matching",
        "The paper’s “appearance” and “mesh” in numbers: median error of the matches, and the share on the limb of the "
        "other side, by region of the body. Lighter is worse.",
        ("matching_by_region", "mirrored_by_region"),
        _draw_regions,
    ),
)


def _draw_scenes(tables: Sequence[Table]) -> Any:
    """Draw one panel per column of errors (a scene with or without holes in its depth images); each panel has a dot per
    method.
    """
    table = tables[0]
    methods, columns = table.methods, [column for column in table.columns if column.unit is Unit.MM]
    wide = min(len(columns), 5)
    tall = -(-len(columns) // wide)
    height = (0.24 * len(methods) + 0.7) * tall + 0.3
    canvas, grid = new_figure(
        max(4.6, 2.2 + 1.65 * wide), height, nrows=tall, ncols=wide, sharey=True, sharex=True, squeeze=False
    )
    for axes, column in zip(grid.flat, columns, strict=False):
        draw_dots(axes, table, column.key, methods)
        axes.set_title(column.label.replace(", ", "\n"))
        axes.set_xlim(left=0)
    for axes in grid.flat[len(columns) :]:
        axes.set_visible(False)
    name_rows(grid[0, 0], methods)
    canvas.supxlabel("mean joint error (mm)", fontsize=9)
    return canvas


SCENES_FIGURES = (
    FigureSpec(
        "scenes",
        "Beyond the paper: mean joint error by scene; with the largest hole where holes are cut. Within a panel, every "
        "method on the same frames.",
        ("scenes",),
        _draw_scenes,
    ),
    FigureSpec(
        "ablation",
        "Beyond the paper: anchorpose’s tracker without one component at a time. Within a panel, the same joints in "
        "the same frames.",
        ("ablation",),
        _draw_scenes,
    ),
)


TICKS = tuple(step * 10.0**power for power in range(-5, 5) for step in (1, 3))


def _draw_times(tables: Sequence[Table]) -> Any:
    table = tables[0]
    methods, columns = table.methods, table.columns
    canvas, grid = new_figure(8.2, 0.27 * len(methods) + 1.2, ncols=len(columns), sharey=True, squeeze=False)
    for axes, column in zip(grid[0], columns, strict=True):
        axes.set_xscale("log")
        low, high = _limits(table, column.key)
        axes.set_xlim(low, high)
        ticks = [tick for tick in TICKS if low <= tick <= high]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.set_xticks([], minor=True)
        draw_dots(axes, table, column.key, methods)
        axes.set_title(column.label)
        axes.set_xlabel("seconds on one core")
        if column.key == "describe":
            axes.axvline(PAPER_FEATURE_S, color=FAINT, linewidth=1, linestyle=(0, (4, 3)))
    name_rows(grid[0, 0], methods)
    return canvas


def _limits(table: Table, column: str) -> tuple[float, float]:
    """Return the limits in s of an axis of times: half of the shortest time in the column, and twice the longest."""
    means = [row.value.mean for row in table.rows if row.column.key == column and row.value.mean > 0]
    return (min(means) / 2, max(means) * 2) if means else (0.01, 1.0)


TIMES_FIGURES = (
    FigureSpec(
        "times",
        "Seconds on one core. Dashed: the paper’s 0.23 s for its feature, on a larger mesh and without matching.",
        ("times",),
        _draw_times,
    ),
)


FIGURES: tuple[FigureSpec, ...] = (
    *BY_SIZE_FIGURES,
    *RATIO_FIGURES,
    *BY_JOINT_FIGURES,
    *REGIONS_FIGURES,
    *PRINCETON_FIGURES,
    *TIMES_FIGURES,
    *SCENES_FIGURES,
    *OTHERS,
)


def draw_all(tables: Sequence[Table]) -> list[DrawnFigure]:
    """Draw every figure whose tables exist. Raises MissingPackage without matplotlib."""
    by_key = {table.key: table for table in tables if table.rows}
    return [
        as_picture(figure, [by_key[key] for key in figure.tables])
        for figure in FIGURES
        if all(key in by_key for key in figure.tables)
    ]
