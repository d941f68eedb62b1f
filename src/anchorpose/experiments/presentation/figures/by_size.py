"""Errors over the sizes of hole: the paper's Figs. "result1" and "sd1"."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from anchorpose.experiments.presentation.figures.drawing import Figure, draw_lines, new_figure, place_legend
from anchorpose.experiments.presentation.tables import Table
from anchorpose.experiments.presentation.tracking_tables import OTHER_HOLES

SAME = "Every method on the same frames; bars hold the mean 95 times in 100."


def _draw(tables: Sequence[Table], what: str) -> Any:
    table = tables[0]
    canvas, axes = new_figure(8.2, 4.6)
    places = [float(column.key) for column in table.columns]
    draw_lines(axes, table, places)
    axes.set_xticks(places, [column.label for column in table.columns])
    axes.set_xlabel("radius of the hole")
    axes.set_ylabel(what)
    place_legend(canvas, axes)
    return canvas


RESULT1 = Figure(
    "result1",
    f"The paper’s “result1”: mean error of all joints (r_or) by size of hole. {SAME}",
    ("result1_same_frames",),
    lambda tables: _draw(tables, "mean joint error (mm)"),
)
SD1 = Figure(
    "sd1",
    f"The paper’s “sd1”: standard deviation over frames of a frame’s mean error, by size of hole. {SAME}",
    ("sd1_same_frames",),
    lambda tables: _draw(tables, "standard deviation (mm)"),
)
OTHERS = tuple(
    Figure(
        f"{scene}_by_size",
        f"Beyond the paper: mean error of all joints by size of hole in the scene “{scene}”. {SAME}",
        (f"{scene}_by_size_same_frames",),
        lambda tables: _draw(tables, "mean joint error (mm)"),
    )
    for scene in OTHER_HOLES
)
FIGURES = (RESULT1, SD1)
