"""What a suite is made of: cases, each a recording and how the program is measured on it."""

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
    """A script of ``probes`` that measures with inner parts of the program, and its options."""

    script: str
    options: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Case:
    """One run: a recording, how the patient is named in it, and how its results are scored.

    row: the scene class; name: returns settings that differ from the defaults, or None to leave the recording out;
    score: returns the scores, or pairs of a part's name and its scores, which get rows of their own; refused: the
    scores of a recording that is refused. probe: measures instead of tracking; its parts get rows of their own.
    """

    row: str
    recording: Recording
    score: Callable[[Ready, Path], Any] = scores.against_truth
    name: Callable[[Ready], dict[str, Any] | None] = field(default=lambda ready: {})
    refused: Callable[[], Scores] = dict
    probe: Probe | None = None


@dataclass(frozen=True, slots=True)
class Suite:
    """cases: of a use, all or the few of ``--quick``. alone: run one after another, so that times can be compared.
    minutes: of a processor, about, for all cases with their simulation; ``--docs`` measures the cheapest first."""

    about: str
    cases: Callable[[Use, bool], Iterator[Case]]
    alone: bool = False
    minutes: int = 10
