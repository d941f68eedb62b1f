"""All figures, in the order of the page."""

from __future__ import annotations

from collections.abc import Sequence

from anchorpose.experiments.presentation.figures import by_joint, by_size, princeton, ratio, regions, scenes, times
from anchorpose.experiments.presentation.figures.drawing import Figure, Picture, as_picture
from anchorpose.experiments.presentation.tables import Table

FIGURES: tuple[Figure, ...] = (
    *by_size.FIGURES, *ratio.FIGURES, *by_joint.FIGURES, *regions.FIGURES, *princeton.FIGURES, *times.FIGURES,
    *scenes.FIGURES, *by_size.OTHERS,
)  # fmt: skip


def draw_all(tables: Sequence[Table]) -> list[Picture]:
    """Every figure whose tables there are. Raises MissingPackage without matplotlib."""
    by_key = {table.key: table for table in tables if table.rows}
    return [
        as_picture(figure, [by_key[key] for key in figure.tables])
        for figure in FIGURES
        if all(key in by_key for key in figure.tables)
    ]
