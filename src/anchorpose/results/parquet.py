"""Read and write the results' Parquet files, and declare tables of records. The same values are always written as the
same bytes.

Only this module opens parquet files: it writes every page with a checksum, and verifies the checksums on reading.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from keyword import iskeyword
from pathlib import Path
from types import NoneType
from typing import Any, Final, Generic, TypeVar, get_args, get_type_hints

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from anchorpose.errors import InputError
from anchorpose.recording.regular_file import LARGEST_ARRAYS, require_regular

Row = TypeVar("Row")

ROWS_AT_ONCE: Final = 1 << 15
"""Maximum number of rows that are read from a table at once; they take some megabytes of memory."""

TRACK_AGAIN: Final = "track the recording again"
MEASURE_AGAIN: Final = "run 'anchorpose measure' on its folder again"


class RowGroups(Generic[Row]):
    """A writer that appends rows to an open parquet file; memory holds at most one row group."""

    def __init__(self, writer: Any, to_table: Callable[[Sequence[Row]], pa.Table], size: int) -> None:
        self._writer, self._to_table, self._size, self._rows = writer, to_table, size, list[Row]()

    def append(self, row: Row) -> None:
        """Add one row."""
        self._rows.append(row)
        if len(self._rows) == self._size:
            self.flush()

    def flush(self) -> None:
        """Write the rows that are still in memory."""
        if self._rows:
            self._writer.write_table(self._to_table(self._rows))
            self._rows = []


def open_parquet(path: Path, schema: pa.Schema) -> Any:
    """Open a parquet writer with fixed values of all options that affect the bytes of the file."""
    return pq.ParquetWriter(
        path, schema, version="2.6", compression="zstd", compression_level=3, write_page_checksum=True
    )


def read_parquet(path: Path, schema: pa.Schema, rows: Any = None, later: Mapping[str, Any] | None = None) -> pa.Table:
    """Read a table; raises InputError unless the file has exactly the columns of ``schema``, and nulls only where the
    schema allows them.

    rows: a pyarrow expression that selects the rows to read; None for all. later: columns that files of older versions
    lack, and the values to use instead.
    """
    table = _with_columns(read_any_parquet(path, rows), schema, later or {})
    require_columns(path, table.schema, schema)
    for column in schema:
        if not column.nullable and table[column.name].null_count:
            raise InputError(path, f"has rows without a {column.name}", TRACK_AGAIN)
    return table


def _with_columns(table: pa.Table, schema: pa.Schema, later: Mapping[str, Any]) -> pa.Table:
    """Add the columns of ``later`` that the table lacks, at their places in ``schema``."""
    for place, column in enumerate(schema):
        if column.name in later and column.name not in table.schema.names:
            values = pa.array([later[column.name]] * table.num_rows, column.type)
            table = table.add_column(min(place, table.num_columns), column, values)
    return table


def read_any_parquet(path: Path, rows: Any = None, columns: list[str] | None = None) -> pa.Table:
    """Read a table with all of its columns, or only the named columns; raises InputError if the file is damaged or
    lacks a named column.

    rows: a pyarrow expression that selects the rows to read; None for all.
    """
    with refuse_unreadable(path):
        table = pq.read_table(path, filters=rows, columns=columns, page_checksum_verification=True)
        _require_names(table.schema)
    return table


def read_parquet_schema(path: Path) -> pa.Schema:
    """Return the names, types and metadata of a table, without reading its rows; raises InputError if the file is
    damaged.
    """
    with refuse_unreadable(path):
        schema = pq.read_schema(path)
        _require_names(schema)
    return schema


def _require_names(schema: pa.Schema) -> list[str]:
    """Return the names of the columns. pyarrow decodes the names only when they are accessed here; raises
    UnicodeDecodeError if a name is damaged.
    """
    return list(schema.names)


@contextmanager
def opened_parquet(path: Path) -> Iterator[Any]:
    """Open a parquet file, whose rows can then be read with ``pieces``; raises InputError if reading in the ``with``
    block shows that it is damaged.
    """
    with refuse_unreadable(path), pq.ParquetFile(path, page_checksum_verification=True) as file:
        _require_names(file.schema_arrow)
        yield file


def pieces(file: Any) -> Iterator[pa.Table]:
    """Yield the rows of an open file in their order, at most ``ROWS_AT_ONCE`` at a time."""
    for group in range(file.num_row_groups):  # one group at a time, else pyarrow holds several groups in memory
        for batch in file.iter_batches(ROWS_AT_ONCE, row_groups=[group], use_threads=False):
            yield pa.Table.from_batches([batch])


_TYPES: Final = {int: pa.int32(), float: pa.float64(), bytes: pa.binary()}


def schema_of(record: type, *names: str) -> pa.Schema:
    """Return the columns of a dataclass ``record``: one per attribute or property in ``names``, or per attribute if no
    names are given.

    A column may be null if the type of its attribute allows None. Types other than numbers and bytes are stored as
    text. A column whose name is a Python keyword, such as ``with``, belongs to the attribute with an underscore
    appended.
    """
    hints = get_type_hints(record)
    hints |= {
        name: get_type_hints(getattr(record, name).fget)["return"] for name in names if _attribute(name) not in hints
    }
    types = {name: hints[_attribute(name)] for name in names or hints}
    return pa.schema(
        [
            pa.field(name, _TYPES.get((get_args(kind) or (kind,))[0], pa.string()), NoneType in get_args(kind))
            for name, kind in types.items()
        ]
    )


def _attribute(column: str) -> str:
    return f"{column}_" if iskeyword(column) else column


@contextmanager
def refuse_unreadable(path: Path) -> Iterator[None]:
    """Raise InputError if reading the file at ``path`` in the ``with`` block shows that it is missing or unreadable."""
    try:
        require_regular(path, LARGEST_ARRAYS)
        yield
    except FileNotFoundError:
        raise InputError(path, "there is no such file", "give a results folder made by 'anchorpose track'") from None
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        if "CRC" in str(error):
            remedy = f"copy it again, or {TRACK_AGAIN}"
            raise InputError(path, "is damaged: its checksum does not fit its content", remedy) from None
        raise InputError(path, f"is not a parquet table ({str(error).splitlines()[0][:80]})", TRACK_AGAIN) from None


def require_columns(path: Path, found: pa.Schema, schema: pa.Schema) -> None:
    """Raise InputError unless the file at ``path`` has the names and types of ``schema``."""
    if found.names != schema.names or found.types != schema.types:
        raise InputError(path, f"its columns are not {', '.join(schema.names)}", TRACK_AGAIN)


def require_within(path: Path, name: str, values: np.ndarray, limits: tuple[float, float], remedy: str) -> None:
    """Raise InputError if a value (n,) of the column ``name`` is NaN, below ``limits[0]`` or above ``limits[1]``."""
    wrong = values[~((values >= limits[0]) & (values <= limits[1]))]
    if len(wrong):
        raise InputError(path, f"has the {name} {wrong[0]:.6g}, not {limits[0]:g} to {limits[1]:g}", remedy)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordTable(Generic[Row]):
    """A table with one row per record.

    record: the dataclass of a row, whose attributes have the names of the columns. known: by column, the texts that the
    column may contain. limits: by column, the minimum and the maximum of its numbers. rows_per_group: number of rows
    per row group; it never changes, so that the same values always give the same bytes in the file. may_be_empty:
    whether the program sometimes writes the table without rows. later: columns that files of older versions lack, and
    the values to use instead.
    """

    file: str
    record: type[Row]
    schema: pa.Schema
    known: Mapping[str, Collection[str | None]] = field(default_factory=dict)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    rows_per_group: int = 1024
    may_be_empty: bool = True
    later: Mapping[str, Any] = field(default_factory=dict)
    remedy: str

    def write(self, path: Path, records: Sequence[Row], metadata: dict[str, str] | None = None) -> None:
        """Write the whole table, with the rows in the order given."""
        schema = self.schema.with_metadata(metadata) if metadata else self.schema
        with open_parquet(path, schema) as writer:
            writer.write_table(self._to_table(records).replace_schema_metadata(metadata))

    @contextmanager
    def open(self, path: Path, metadata: dict[str, str] | None = None) -> Iterator[RowGroups[Row]]:
        """Open the file for writing row by row; it is complete when the ``with`` block ends without an error."""
        with open_parquet(path, self.schema.with_metadata(metadata) if metadata else self.schema) as writer:
            groups: RowGroups[Row] = RowGroups(
                writer, lambda rows: self._to_table(rows).replace_schema_metadata(metadata), self.rows_per_group
            )
            yield groups
            groups.flush()

    def read(self, path: Path, rows: Any = None) -> tuple[Row, ...]:
        """Read all records, or the records that the pyarrow expression ``rows`` selects; raises InputError if the file
        is not such a table.
        """
        table = read_parquet(path, self.schema, rows, self.later)
        if rows is None and not self.may_be_empty and not table.num_rows:
            raise InputError(path, "has no rows", self.remedy)
        return self.records(path, table)

    def records(self, path: Path, table: pa.Table) -> tuple[Row, ...]:
        """Return the rows of a table as records; raises InputError, which names ``path``, for impossible rows."""
        for column, known in self.known.items():
            for text in table[column].unique().to_pylist():
                if text not in known:
                    raise InputError(path, f"holds the unknown {column} '{text}'", self.remedy)
        for column, limits in self.limits.items():
            require_within(path, column, table[column].drop_null().to_numpy(), limits, self.remedy)
        attributes = {each.name for each in fields(self.record)}  # type: ignore[arg-type]
        own = [name for name in self.schema.names if _attribute(name) in attributes]
        table = table.select(own).rename_columns([_attribute(name) for name in own])
        try:
            return tuple(self.record(**row) for row in table.to_pylist())
        except ValueError as error:
            raise InputError(path, f"has an impossible row: {error}", self.remedy) from None

    def _to_table(self, records: Sequence[Row]) -> pa.Table:
        columns = [
            pa.array([getattr(record, _attribute(each.name)) for record in records], each.type) for each in self.schema
        ]
        return pa.Table.from_arrays(columns, schema=self.schema)
