"""Errors of each joint over all sizes of hole: the paper's Figs. "result2" and "sd2"."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from anchorpose.experiments.method import PROPOSED, Family
from anchorpose.experiments.presentation.figures.drawing import FAMILY_NAMES, Figure, look_of, most_of, new_figure
from anchorpose.experiments.presentation.tables import Table

PANELS = (
    (Family.PROPOSED,), (Family.LOCAL,), (Family.SPECTRAL,), (Family.MESH, Family.GLOBAL),
    (Family.NONE, Family.TRACKER),
)  # fmt: skip


def _draw(tables: Sequence[Table], what: str) -> Any:
    """A panel for each kind of method; the proposed one comes again in every panel, to compare with."""
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

RESULT2 = Figure(
    "result2",
    f"The paper’s “result2”: mean error of each joint (r_i). {NOTE}",
    ("result2_same_frames",),
    lambda tables: _draw(tables, "mean error (mm)"),
)
SD2 = Figure(
    "sd2",
    f"The paper’s “sd2”: standard deviation of each joint’s error. {NOTE}",
    ("sd2_same_frames",),
    lambda tables: _draw(tables, "standard deviation (mm)"),
)
FIGURES = (RESULT2, SD2)
