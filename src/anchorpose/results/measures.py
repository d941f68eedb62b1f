"""measures.parquet: what a session of stand training amounts to, one row a number, with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pyarrow as pa

from anchorpose.results.tables import open_parquet, read_parquet

MEASURES_FILE: Final = "measures.parquet"

MEASURES_SCHEMA: Final = pa.schema(
    [
        pa.field("measure", pa.string(), nullable=False),
        pa.field("side", pa.string()),
        pa.field("part", pa.string()),
        pa.field("person", pa.string()),
        pa.field("value", pa.float64()),
        pa.field("unit", pa.string(), nullable=False),
        pa.field("sigma", pa.float64()),
        pa.field("frames", pa.int32(), nullable=False),
        pa.field("inferred_share", pa.float64()),
        pa.field("why", pa.string()),
    ]
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """One number of docs/measures.md.

    side: "left", "right" or None. part: a region of the body (``REGIONS``), person: as in contacts.parquet; None where
    the measure is of no one part or person. value: None where it cannot be told, and then ``why`` says why. sigma: one
    standard deviation of the value, None where none is known (counts). frames: how many it rests on. inferred_share: of
    these frames, those in which a joint that it uses was inferred rather than seen.
    Raises ValueError where value and why disagree: one of the two is given, never both.
    """

    measure: str
    value: float | None
    unit: str
    side: str | None = None
    part: str | None = None
    person: str | None = None
    sigma: float | None = None
    frames: int
    inferred_share: float | None = None
    why: str | None = None

    def __post_init__(self) -> None:
        if (self.value is None) != (self.why is not None):
            raise ValueError(f"{self.measure} has the value {self.value} and the reason for none {self.why!r}")


def write_measures(path: Path, measures: Sequence[Measure]) -> None:
    """Writes measures.parquet in the order given; the same bytes for the same measures."""
    columns = [pa.array([getattr(row, field.name) for row in measures], field.type) for field in MEASURES_SCHEMA]
    with open_parquet(path, MEASURES_SCHEMA) as writer:
        writer.write_table(pa.Table.from_arrays(columns, schema=MEASURES_SCHEMA))


def read_measures(path: Path) -> tuple[Measure, ...]:
    """All rows of a measures.parquet; raises InputError where it is none."""
    return tuple(Measure(**row) for row in read_parquet(path, MEASURES_SCHEMA).to_pylist())
