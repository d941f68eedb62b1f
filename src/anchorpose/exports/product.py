"""What a format's writer tells of its work, for export.json.

Numbers as text that reads back as the same number, in the shortest form; nothing where there is none.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum


class Format(StrEnum):
    """The formats of ``anchorpose export``, by the names of ``--to``."""

    TRC = "trc"
    MOT = "mot"
    C3D = "c3d"
    CSV = "csv"
    BVH = "bvh"
    BIDS = "bids"


class CoordinateModel(StrEnum):
    """The OpenSim models whose coordinates a MOT can follow; they differ in the sign of the knee."""

    RAJAGOPAL = "rajagopal"
    GAIT2392 = "gait2392"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportConfig:
    """What people choose. subject, session, task: labels of BIDS, letters and digits only; a session may be absent."""

    subject: str = "01"
    session: str | None = None
    task: str = "standing"
    model: CoordinateModel = CoordinateModel.RAJAGOPAL

    def __post_init__(self) -> None:
        for name in ("subject", "session", "task"):
            label = getattr(self, name)
            if label is not None and not (label.isascii() and label.isalnum()):
                raise ValueError(f"{name} is '{label}', and BIDS allows letters and digits only")


@dataclass(frozen=True, slots=True, kw_only=True)
class Product:
    """axes and units in words; time: what was done to the times; missing: what stands where nothing was measured.

    counts: figures that people check, such as frames written; notes: what else they must know.
    """

    axes: str
    units: str
    time: str
    missing: str
    counts: tuple[tuple[str, float], ...] = ()
    notes: tuple[str, ...] = ()
    tools: tuple[str, ...] = ()  # packages beside our own that wrote the files


def number_text(value: float, missing: str) -> str:
    """The shortest decimal that is the same double again; ``missing`` for NaN."""
    if math.isnan(value):
        return missing
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(float(value))


def rounded_text(value: float, digits: int, missing: str) -> str:
    """With so many digits after the point, without needless zeros; ``missing`` for NaN."""
    if math.isnan(value):
        return missing
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def rows_text(rows: Iterable[Iterable[str]], separator: str) -> str:
    """Lines of cells, each ended by a line feed."""
    return "".join(separator.join(row) + "\n" for row in rows)
