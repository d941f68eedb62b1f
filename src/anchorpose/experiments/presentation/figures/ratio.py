"""What the largest hole costs each method, against none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from anchorpose.experiments.presentation.figures.drawing import FAINT, Figure, draw_dots, name_rows, new_figure
from anchorpose.experiments.presentation.tables import Table
from anchorpose.experiments.presentation.tracking_claims import CONSTANT


def _draw(tables: Sequence[Table]) -> Any:
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


FIGURES = (
    Figure(
        "ratio",
        f"Mean joint error with the largest hole over that without, in the same frames. Dashed: {CONSTANT}, to which "
        "the claims hold “almost constant”.",
        ("ratio_same_frames", "ratio_occluded_same_frames"),
        _draw,
    ),
)
