"""What one check says: a level, what was measured, and what to do about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple


class Level(IntEnum):
    """How serious a finding is, by what tracking makes of it."""

    GREEN = 0  # as it should be
    YELLOW = 1  # results will be less accurate, or have gaps
    RED = 2  # results will be wrong or missing

    @property
    def word(self) -> str:
        """As people read it."""
        return self.name.lower()


@dataclass(frozen=True, slots=True)
class Finding:
    """check: its name; measured: one phrase with units; remedy: what to do, empty where there is nothing to do."""

    check: str
    level: Level
    measured: str
    remedy: str = ""


class OfCamera(NamedTuple):
    """One camera's share of a finding; remedy: empty where there is nothing to do."""

    camera: str
    level: Level
    measured: str
    remedy: str = ""


def level_of(value: float, yellow: float, red: float) -> Level:
    """By limits above which a value is yellow and red; NaN is green: nothing speaks against it."""
    return Level.RED if value > red else Level.YELLOW if value > yellow else Level.GREEN


def of_cameras(check: str, parts: Sequence[OfCamera]) -> Finding:
    """One finding of several cameras, with the worst one's level; cameras are named where there are several.

    What is green is left out beside what is not, and so is the remedy of what is green.
    """
    level = max(part.level for part in parts)
    told = [part for part in parts if part.level > Level.GREEN or level is Level.GREEN]
    measured: dict[str, list[str]] = {}
    for part in told:
        measured.setdefault(part.measured, []).append(part.camera)
    named = [text if len(parts) == 1 else f"{', '.join(names)}: {text}" for text, names in measured.items()]
    remedies = dict.fromkeys(part.remedy for part in told if part.level > Level.GREEN and part.remedy)
    return Finding(check, level, "; ".join(named), "; ".join(remedies))
