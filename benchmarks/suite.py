"""Define suites and their cases: a case is a recording and the way in which the program is measured on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import scores
from recordings import Ready, Recording

Use = Literal["tuning", "held-out"]
Scores = dict[str, float]


@dataclass(frozen=True, slots=True)
class Probe:
    """A script in ``probes`` that measures by calling internal modules of the program, and the script's options."""

    script: str
    options: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Case:
    """One run: a recording, how a user points out its patient, and how its results are scored.

    row: the scene class; name: returns settings that differ from the defaults, or None to leave the recording out;
    score: returns the scores, or for several parts pairs of a name and its scores, each for a row of its own; refused:
    returns the scores of a refused recording. probe: measures in place of tracking, with a row for each of its parts.
    """

    row: str
    recording: Recording
    score: Callable[[Ready, Path], Any] = scores.against_truth
    name: Callable[[Ready], dict[str, Any] | None] = field(default=lambda ready: {})
    refused: Callable[[], Scores] = dict
    probe: Probe | None = None


@dataclass(frozen=True, slots=True)
class Suite:
    """A suite. cases: returns the cases of a use, all or only those of ``--quick``. alone: whether cases run one after
    another, so that times can be compared. minutes: approximate processor time for all cases and their simulation;
    ``--docs`` measures the suites with the fewest minutes first."""

    about: str
    cases: Callable[[Use, bool], Iterator[Case]]
    alone: bool = False
    minutes: int = 10
