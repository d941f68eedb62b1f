"""measures.parquet: what a session of stand training amounts to, one row a number, with its uncertainty."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from anchorpose import __version__
from anchorpose.errors import InputError
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


DEFINITION_KEY: Final = "measure_definition"
"""Of the schema's metadata: a JSON text of ``Definition``."""


@dataclass(frozen=True, slots=True)
class Definition:
    """What the numbers were computed by: a measure of another one may have the same name and be another number.

    anchorpose: the version of the program. config: the thresholds, as nested dicts of JSON values.
    """

    anchorpose: str
    config: dict[str, Any]


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


def write_measures(path: Path, measures: Sequence[Measure], config: dict[str, Any]) -> None:
    """Writes measures.parquet in the order given, and in its metadata by which version and ``config`` (nested dicts of
    JSON values) they were computed; the same bytes for the same measures."""
    definition = json.dumps({"anchorpose": __version__, "config": config}, sort_keys=True)
    schema = MEASURES_SCHEMA.with_metadata({DEFINITION_KEY: definition})
    columns = [pa.array([getattr(row, field.name) for row in measures], field.type) for field in schema]
    with open_parquet(path, schema) as writer:
        writer.write_table(pa.Table.from_arrays(columns, schema=schema))


def read_measures(path: Path) -> tuple[Measure, ...]:
    """All rows of a measures.parquet; raises InputError where it is none."""
    return tuple(Measure(**row) for row in read_parquet(path, MEASURES_SCHEMA).to_pylist())


def read_definition(path: Path) -> Definition | None:
    """By what a measures.parquet was computed; None of one that was written before that was recorded.

    Raises InputError where the record cannot be read.
    """
    text = (pq.read_schema(path).metadata or {}).get(DEFINITION_KEY.encode())
    if text is None:
        return None
    try:
        return Definition(**json.loads(text))
    except (ValueError, TypeError):
        problem = "does not say in a readable way how its measures were computed"
        raise InputError(path, problem, "run 'anchorpose measure' on its folder again") from None
