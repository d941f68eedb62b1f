"""Make the README's table: a row for each situation, which also states what the recordings were compared with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from blocks import Wanted
from remarks import Measured, known_values

Rows = Mapping[str, Measured]


@dataclass(frozen=True, slots=True)
class Headline:
    """A row. rows: beginning of the names of the suite's rows to use; figure: returns words from their scores."""

    situation: str
    compared: str
    wanted: Wanted
    rows: str
    figure: Callable[[Sequence[Measured]], str]


def _joints(rows: Sequence[Measured]) -> str:
    mean_mm = known_values("mean_mm", rows[0])
    return f"{mean_mm.mean():.1f} mm, the worst of {mean_mm.size} recordings {mean_mm.max():.1f}"


def _joints_and_confident(rows: Sequence[Measured]) -> str:
    share = 100.0 * known_values("confident", rows[0]).mean()
    refused = sum(one.get("refused", 0.0) for one in rows[0])
    also = f"; {refused:.0f} more refused" if refused else ""
    return f"{_joints(rows)}; {share:.2f} % of the joints are over 100 mm and four sigma off{also}"


def _thighs(rows: Sequence[Measured]) -> str:
    ours, kinect = (
        np.mean([np.median(known_values(name, measured)) for measured in rows]) for name in ("tilt_deg", "kinect_deg")
    )
    count = sum(known_values("tilt_deg", measured).size for measured in rows)
    return f"{ours:.1f} degrees in {count} recordings; the Kinect's own skeleton {kinect:.1f}"


def _labels(rows: Sequence[Measured]) -> str:
    labels, within, median = (known_values(name, rows[0]) for name in ("labels", "within_100", "median_mm"))
    share = 100.0 * np.average(within, weights=labels)
    return f"{share:.0f} % of {labels.sum():.0f} joints within 100 mm, the median {np.median(median):.0f} mm"


REAL: Final = Wanted("real")
EASY: Final = Wanted("easy", "held-out")
HARD: Final = Wanted("hard", "held-out")
HEADLINES: Final = (
    Headline("**real depth**, a Kinect, 4 people", "inertial sensor on the thigh", REAL, "thigh sensor", _thighs),
    Headline("**real depth**, a Kinect, 5 people", "joints labelled by eye", REAL, "MSR Action3D: labels", _labels),
    Headline("simulated, one camera, nobody else", "truth", EASY, "one camera, nobody else", _joints),
    Headline("simulated clinic, three cameras, frame, two therapists", "truth", EASY, "clinic: three cameras", _joints),
    Headline("the same, front camera alone", "truth", EASY, "the same clinic, front camera alone", _joints),
    Headline(
        "simulated rehabilitation in equipment, people in the way, three cameras",
        "truth",
        HARD,
        "hard scenes, three cameras",
        _joints_and_confident,
    ),
    Headline("the same, front camera alone", "truth", HARD, "hard scenes, front camera alone", _joints_and_confident),
)


def headline_table(measured: Mapping[Wanted, Rows]) -> str:
    """Return the table as Markdown. Raises KeyError for a row that was not measured."""
    lines = ["| situation | compared with | |", "|---|---|--:|"]
    for one in HEADLINES:
        rows = [scores for name, scores in measured[one.wanted].items() if name.startswith(one.rows)]
        if not rows:
            raise KeyError(one.rows)
        lines.append(f"| {one.situation} | {one.compared} | {one.figure(rows)} |")
    return "\n".join(lines)
