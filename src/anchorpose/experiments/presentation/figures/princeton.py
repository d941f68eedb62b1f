"""How many matches lie within a distance along the skin (the Princeton protocol)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from anchorpose.experiments.presentation.figures.drawing import Figure, draw_lines, new_figure, place_legend
from anchorpose.experiments.presentation.tables import Table


def _draw(tables: Sequence[Table]) -> Any:
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


FIGURES = (
    Figure(
        "princeton",
        "Share of all nodes whose match lies within a distance of its true place, measured along the skin "
        "(Kim et al. 2011, doi:10.1145/2010324.1964974). A node without a match lies within none. Direct matches; "
        "those after the tree for methods that have no direct ones.",
        ("princeton_mm", "princeton_height"),
        _draw,
    ),
)
