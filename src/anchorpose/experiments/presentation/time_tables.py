"""What it costs: seconds on one core, beside the paper's."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.experiments.config import Scene
from anchorpose.experiments.outcome import Outcome, PaperTimes
from anchorpose.experiments.presentation.selection import Matching, Tracking, compared
from anchorpose.experiments.presentation.statistics import mean_over, ratio_of
from anchorpose.experiments.presentation.tables import Column, Row, Table, Unit

PAPER_MESH_S: Final = 0.72
PAPER_FEATURE_S: Final = 0.23
PAPER_NODES: Final = 15549
PAPER_EDGES: Final = 36185
"""Section V-B, one core of an Intel i7-6700."""


def time_tables(outcome: Outcome) -> list[Table]:
    """Seconds per method."""
    rows = [*_matching_rows(outcome), *_tracking_rows(outcome)]
    note = (
        "Of one core. Descriptors and matches: for one pair of frames, with the nodes of that mesh. Tracking: all "
        "that a frame needs. The paper’s feature took 0.23 s on a mesh of 15,549 nodes."
    )
    return [Table("times", "Time, s", "what", note, tuple(rows))] if rows else []


def paper_time_lines(times: PaperTimes) -> list[tuple[str, str, str]]:
    """What was timed, here, in the paper."""
    return [
        ("nodes of the mesh", f"{times.nodes}", f"{PAPER_NODES}"),
        ("edges of the mesh", f"{times.edges}", f"{PAPER_EDGES}"),
        ("mesh", f"{times.mesh_s:.3g} s", f"{PAPER_MESH_S} s"),
        ("feature, five anchors, fast marching", f"{times.feature_s:.3g} s", "–"),
        ("feature, five anchors, Dijkstra", f"{times.dijkstra_s:.3g} s", f"{PAPER_FEATURE_S} s"),
    ]


def _matching_rows(outcome: Outcome) -> list[Row]:
    matching, column = Matching(outcome), Column("describe", "descriptors and matches", Unit.SECONDS)
    return [
        Row(method, column, mean_over(
            list(matching.values(method.key, lambda match: np.array([match.describe_s])).values()),
            outcome.config.resamples))
        for method in matching.methods
    ]  # fmt: skip


def _tracking_rows(outcome: Outcome) -> list[Row]:
    tracking, column = Tracking(outcome), Column("track", "tracking, per frame", Unit.SECONDS)
    rows = []
    resamples = outcome.config.resamples
    for method in tracking.ran(Scene.PAPER, compared(outcome.methods)):
        seconds: dict[str, list[float]] = {}
        frames: dict[str, list[float]] = {}
        for hole in tracking.holes(Scene.PAPER):
            for recording, run in tracking.runs(Scene.PAPER, method.key, hole).items():
                if len(run.frame):
                    seconds.setdefault(recording, []).append(run.seconds)
                    frames.setdefault(recording, []).append(len(run.frame))
        spent, had = ([np.array(values) for _, values in sorted(of.items())] for of in (seconds, frames))
        rows.append(Row(method, column, ratio_of(spent, had, resamples)))
    return rows
