"""Errors of the matches on each region of the body, and how many are on the other side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from anchorpose.experiments.presentation.figures.drawing import Figure, draw_heat, most_of, new_figure
from anchorpose.experiments.presentation.tables import Table


def _draw(tables: Sequence[Table]) -> Any:
    rows = len(tables[0].methods)
    canvas, grid = new_figure(9.6, 0.27 * rows + 1.5, ncols=2, sharey=True, squeeze=False)
    draw_heat(grid[0, 0], tables[0], most_of(tables[0]), lambda value: f"{value:.0f}")
    grid[0, 0].set_title("median error (mm)")
    draw_heat(grid[0, 1], tables[1], max(0.5, most_of(tables[1])), lambda value: f"{100 * value:.0f}")
    grid[0, 1].set_title("on the other side’s limb (%)")
    return canvas


FIGURES = (
    Figure(
        "matching",
        "What the paper’s “appearance” and “mesh” show in pictures, in numbers: median error of the matches, and the "
        "share that lies on the other side’s limb, by region of the body. Lighter is worse.",
        ("matching_by_region", "mirrored_by_region"),
        _draw,
    ),
)
