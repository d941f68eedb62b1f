"""Errors in each scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from anchorpose.experiments.presentation.figures.drawing import Figure, draw_dots, name_rows, new_figure
from anchorpose.experiments.presentation.tables import Table


def _draw(tables: Sequence[Table]) -> Any:
    """A panel for each scene."""
    table = tables[0]
    methods, columns = table.methods, table.columns
    wide = min(len(columns), 5)
    tall = -(-len(columns) // wide)
    height = (0.24 * len(methods) + 0.7) * tall + 0.3
    canvas, grid = new_figure(max(4.6, 2.2 + 1.65 * wide), height, nrows=tall, ncols=wide, sharey=True, sharex=True,
                              squeeze=False)  # fmt: skip
    for axes, column in zip(grid.flat, columns, strict=False):
        draw_dots(axes, table, column.key, methods)
        axes.set_title(column.label.replace(", ", "\n"))
        axes.set_xlim(left=0)
    for axes in grid.flat[len(columns) :]:
        axes.set_visible(False)
    name_rows(grid[0, 0], methods)
    canvas.supxlabel("mean joint error (mm)", fontsize=9)
    return canvas


FIGURES = (
    Figure(
        "scenes",
        "Beyond the paper: mean joint error by scene; with the largest hole where holes are cut. Within a panel, every "
        "method on the same frames.",
        ("scenes_same_frames",),
        _draw,
    ),
    Figure(
        "ablation",
        "Beyond the paper: each ingredient of the own tracker switched off by itself. Within a panel, the same frames.",
        ("ablation",),
        _draw,
    ),
)
