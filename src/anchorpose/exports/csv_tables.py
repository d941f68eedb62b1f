"""CSV: every table of the results as it is, one wide table a kind, and a file that says what each column means."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from anchorpose.errors import InputError
from anchorpose.exports.data_dictionary import describe_column, describe_wide_column
from anchorpose.exports.numbers_text import number_text
from anchorpose.exports.product import ExportConfig, Product
from anchorpose.exports.source import STATES, Source
from anchorpose.joints import JOINT_NAMES

DICTIONARY_FILE: Final = "data_dictionary.csv"
DICTIONARY_HEAD: Final = ("file", "column", "type", "unit", "meaning", "missing")

Column = tuple[str, np.ndarray | Sequence[str]]


def write_csv(folder: Path, source: Source, config: ExportConfig) -> Product:
    """A CSV for each table without pictures, joints_wide.csv, angles_wide.csv and data_dictionary.csv."""
    dictionary, notes, rows = list[tuple[str, ...]](), list[str](), 0
    for path in sorted(source.folder.glob("*.parquet")):
        kinds = _readable(path, pq.read_schema).types
        if any(pa.types.is_binary(kind) or pa.types.is_large_binary(kind) for kind in kinds):
            continue  # pictures: whose each pixel is, for the viewer; more of them than the memory may hold
        table = _readable(path, pq.read_table)
        name = f"{path.stem}.csv"
        rows += len(table)
        _write(folder / name, table.schema.names, zip(*(_cells(column) for column in table.columns), strict=True))
        dictionary += [(name, *describe_column(field.name, _kind(field.type))) for field in table.schema]
        notes += _metadata(name, table.schema)
    for name, columns in (("joints_wide.csv", _wide_joints(source)), ("angles_wide.csv", _wide_angles(source))):
        if columns:
            names = [column for column, _ in columns]
            _write(folder / name, names, zip(*(_wide_cells(values) for _, values in columns), strict=True))
            dictionary += [(name, *describe_wide_column(column)) for column in names]
    _write(folder / DICTIONARY_FILE, DICTIONARY_HEAD, dictionary)
    return _product(len(source.frame), rows, notes)


def _product(frames: int, rows: int, notes: list[str]) -> Product:
    return Product(
        axes="X forward, Y up, Z to the patient's right",
        units="in the names of the columns (_m metres, _s seconds, _deg and degrees) and in the data dictionary",
        time="as recorded",
        missing="an empty cell; state says why",
        counts=(("frames", frames), ("rows_of_long_tables", rows)),
        notes=(
            f"{DICTIONARY_FILE} says what each column means.",
            "UTF-8, commas, decimal points, one line of names.",
            *notes,
        ),
    )


def _metadata(name: str, schema: pa.Schema) -> list[str]:
    """What the table says of itself, such as how it was smoothed: a CSV has no place for that."""
    told = {key.decode(): value.decode(errors="replace") for key, value in (schema.metadata or {}).items()}
    return [f"{name}, {key}: {value}" for key, value in told.items() if key != "pandas"]


def _readable(path: Path, read: Callable[[Path], Any]) -> Any:
    """What ``read`` makes of a table; raises InputError where it cannot."""
    try:
        return read(path)
    except (pa.ArrowException, OSError):
        raise InputError(path, "is no parquet table", "track the recording again") from None


def _kind(kind: pa.DataType) -> str:
    if pa.types.is_boolean(kind):
        return "true or false"
    if pa.types.is_integer(kind):
        return "whole number"
    return "number" if pa.types.is_floating(kind) else "text"


def _cells(column: pa.ChunkedArray) -> list[str]:
    if pa.types.is_float32(column.type):  # the shortest text of the single precision number, not of its double
        return ["" if value is None or value != value else str(np.float32(value)) for value in column.to_pylist()]
    return [_cell(value) for value in column.to_pylist()]


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return number_text(value, "") if isinstance(value, float) else str(value)


def _wide_cells(values: np.ndarray | Sequence[str]) -> list[str]:
    return [_cell(value) for value in (values.tolist() if isinstance(values, np.ndarray) else values)]


def _wide_joints(source: Source) -> list[Column]:
    samples = source.samples
    columns: list[Column] = [("frame", source.frame), ("time_s", samples.time_s)]
    for number, name in enumerate(JOINT_NAMES):
        columns += [(f"{name}_{axis}_m", samples.position_m[:, number, place]) for place, axis in enumerate("xyz")]
        columns.append((f"{name}_sigma_m", samples.joint_sigma_m[:, number]))
        columns.append((f"{name}_state", [STATES[code] for code in samples.joint_severity[:, number]]))
    return columns


def _wide_angles(source: Source) -> list[Column]:
    samples = source.samples
    if not samples.angles:
        return []
    columns: list[Column] = [("frame", source.frame), ("time_s", samples.time_s)]
    for number, name in enumerate(samples.angles):
        columns.append((f"{name}_deg", samples.degrees[:, number]))
        columns.append((f"{name}_sigma_deg", samples.sigma_deg[:, number]))
        columns.append((f"{name}_state", [STATES[code] for code in samples.angle_severity[:, number]]))
    return columns


def _write(path: Path, names: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\r\n")  # RFC 4180
        writer.writerow(names)
        writer.writerows(rows)
