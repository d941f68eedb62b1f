"""How the files of another system are read: settings, which are also options of ``anchorpose evaluate``."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Literal


class HipCentre(StrEnum):
    """Where hip centres come from if the other system gives none."""

    HARRINGTON = "harrington"
    FUNCTIONAL = "functional"


@dataclass(frozen=True, kw_only=True)
class ReferenceSettings:
    """How to read the other system's files; the text below each is the help of its option."""

    unit: Literal["mm", "cm", "m"] | None = None
    """The unit of the reference's lengths, where its file does not state it."""

    names: Path | None = None
    """A CSV with the columns joint,label: which labels of the reference are which joint."""

    hip: HipCentre = HipCentre.HARRINGTON
    """Hip centres from pelvis markers: by the regression of Harrington et al. 2007, or from the thigh's movement."""

    transform: Path | None = None
    """A JSON file with reference_to_world, if the position of the reference's axes is known."""

    exchange_sides: bool = False
    """The reference has left and right the wrong way round."""
