"""Seconds of each method beside the paper's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from anchorpose.experiments.presentation.figures.drawing import FAINT, Figure, draw_dots, name_rows, new_figure
from anchorpose.experiments.presentation.tables import Table
from anchorpose.experiments.presentation.time_tables import PAPER_FEATURE_S

TICKS = tuple(step * 10.0**power for power in range(-5, 5) for step in (1, 3))


def _draw(tables: Sequence[Table]) -> Any:
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
    """Half of the shortest time to twice the longest: also where all are the same."""
    means = [row.value.mean for row in table.rows if row.column.key == column and row.value.mean > 0]
    return (min(means) / 2, max(means) * 2) if means else (0.01, 1.0)


FIGURES = (
    Figure(
        "times",
        "Seconds on one core. Dashed: the paper’s 0.23 s for its feature, on a larger mesh and without matching.",
        ("times",),
        _draw,
    ),
)
