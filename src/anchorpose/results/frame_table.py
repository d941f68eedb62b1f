"""Declare, write and read parquet tables that have the same rows (such as one per joint) in every frame. In memory, a
table is a dataclass of arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import numpy as np
import pyarrow as pa

from anchorpose.errors import InputError
from anchorpose.recording.recording_file import require_seconds
from anchorpose.results.parquet import RowGroups, open_parquet, read_parquet, require_within

Frames = TypeVar("Frames")

FRAMES_PER_ROW_GROUP: Final = 512
"""Number of frames per row group of a file; in the table of joints, 512 frames take half a megabyte of memory. This
number never changes, so that the same values always give the same bytes in the file.
"""

UNKNOWN: Final = -1
"""Value of a flag that is neither 1 (yes) nor 0 (no)."""


def cut_rows(table: Frames, rows: slice | np.ndarray) -> Frames:
    """Return the dataclass ``table`` with only the chosen rows of all its arrays. rows: a slice, indices (k,) int, or a
    mask (n,) bool.
    """
    values = {each.name: getattr(table, each.name) for each in fields(table)}  # type: ignore[arg-type]
    arrays: dict[str, Any] = {name: value[rows] for name, value in values.items() if isinstance(value, np.ndarray)}
    return replace(table, **arrays)  # type: ignore[type-var]


@dataclass(frozen=True, slots=True)
class Numbers:
    """Columns of numbers, which are one array in memory, of shape (..., names), or (...) for a single name. NaN in
    memory is null in the file.

    least, most: smallest and largest allowed number.
    """

    names: tuple[str, ...]
    least: float
    most: float
    type: pa.DataType = field(default_factory=pa.float64)

    def schema(self) -> list[pa.Field]:
        """Return the declaration of the columns for pyarrow: numbers, which may be null."""
        return [pa.field(name, self.type) for name in self.names]

    def to_arrow(self, values: np.ndarray) -> list[pa.Array]:
        """Convert ``values``, the array of numbers in memory, to the columns of the file."""
        flat = values.astype(self.type.to_pandas_dtype(), copy=False).reshape(-1, len(self.names))
        return [pa.array(column, self.type, from_pandas=True) for column in flat.T]

    def to_numpy(self, path: Path, table: pa.Table, remedy: str) -> np.ndarray:
        """Return the numbers (rows, names), or (rows,) for a single name; raises InputError for a number outside its
        limits.
        """
        columns = [table[name].to_numpy(zero_copy_only=False) for name in self.names]
        for name, values in zip(self.names, columns, strict=True):
            require_within(path, name, values[~np.isnan(values)], (self.least, self.most), remedy)
        return columns[0] if len(columns) == 1 else np.stack(columns, axis=1)


@dataclass(frozen=True, slots=True)
class Codes:
    """A column of texts; in memory, an int8 array of codes, which are indices into ``texts``."""

    name: str
    texts: tuple[str, ...]

    def schema(self) -> list[pa.Field]:
        """Return the declaration of the column for pyarrow: texts, never null."""
        return [pa.field(self.name, pa.string(), nullable=False)]

    def to_arrow(self, values: np.ndarray) -> list[pa.Array]:
        """Convert ``values``, the codes in memory, to the column of texts in the file."""
        return [pa.array(np.array(self.texts, dtype=object)[values.ravel()], pa.string())]

    def to_numpy(self, path: Path, table: pa.Table, remedy: str) -> np.ndarray:
        """Return the codes (rows,) int8; raises InputError for a text that is not one of ``texts``."""
        return _codes(path, table[self.name], self.name, self.texts, remedy).astype(np.int8)


@dataclass(frozen=True, slots=True)
class Flags:
    """A column of the values yes and no, int8 in memory: 1 is yes, 0 is no, ``UNKNOWN`` is null in the file."""

    name: str

    def schema(self) -> list[pa.Field]:
        """Return the declaration of the column for pyarrow: booleans, which may be null."""
        return [pa.field(self.name, pa.bool_())]

    def to_arrow(self, values: np.ndarray) -> list[pa.Array]:
        """Convert ``values``, the flags in memory, to the column of booleans in the file."""
        return [pa.array(values == 1, mask=values == UNKNOWN)]

    def to_numpy(self, path: Path, table: pa.Table, remedy: str) -> np.ndarray:
        """Return the flags (rows,) int8."""
        column = table[self.name].cast(pa.int8()).fill_null(UNKNOWN)
        return column.to_numpy(zero_copy_only=False).astype(np.int8)


Column = Numbers | Codes | Flags


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTable(Generic[Frames]):
    """A table with the same rows in every frame.

    arrays: the dataclass that holds the table in memory, with frame (n,) int32, time_s (n,) float64 and one array per
    entry of ``columns``, (n, ...) or (n, subjects, ...). thing: the column that names the subject of a row, such as
    "joint"; None if the table has one row per frame. names: the subjects in their order; None if the subjects differ
    from file to file and are in the field ``names`` of ``arrays``. agree: function that tests whether the numbers and
    texts of a table are consistent.
    """

    file: str
    arrays: Callable[..., Frames]
    columns: Mapping[str, Column]
    thing: str | None = None
    names: tuple[str, ...] | None = None
    agree: Callable[[Frames], bool] = lambda _: True
    remedy: str

    def schema(self) -> pa.Schema:
        """Return the columns of the file."""
        start = [pa.field("frame", pa.int32(), nullable=False), pa.field("time_s", pa.float64(), nullable=False)]
        thing = [pa.field(self.thing, pa.string(), nullable=False)] if self.thing else []
        return pa.schema([*start, *thing, *(each for column in self.columns.values() for each in column.schema())])

    def write(self, path: Path, frames: Frames, metadata: dict[str, str] | None = None) -> None:
        """Write the whole table."""
        schema, arrays = self.schema(), self._arrays(frames)
        if metadata:
            schema = schema.with_metadata(metadata)
        names: tuple[str, ...] = getattr(frames, "names", ()) if self.names is None else self.names
        with open_parquet(path, schema) as writer:
            for start in range(0, len(arrays["frame"]), FRAMES_PER_ROW_GROUP):
                some = {name: array[start : start + FRAMES_PER_ROW_GROUP] for name, array in arrays.items()}
                writer.write_table(self._to_table(schema, names, some))

    @contextmanager
    def open(self, path: Path) -> Iterator[RowGroups[Any]]:
        """Open the file for writing frame by frame; it is complete when the ``with`` block ends without an error.

        Each appended frame must have the same fields as the dataclass ``arrays``, without their first axis (the
        frames).
        """
        schema = self.schema()

        def to_table(frames: Sequence[Any]) -> pa.Table:
            each = [self._arrays(frame) for frame in frames]
            stacked = {name: np.stack([arrays[name] for arrays in each]) for name in each[0]}
            return self._to_table(schema, self.names or (), stacked)

        with open_parquet(path, schema) as writer:
            groups = RowGroups[Any](writer, to_table, FRAMES_PER_ROW_GROUP)
            yield groups
            groups.flush()

    def read(self, path: Path) -> Frames:
        """Read the table; its rows may be in any order.

        Raises InputError unless every frame has each subject once, times increase, and every number is within its
        limits.
        """
        table = read_parquet(path, self.schema())
        names = self.names or (tuple(table[self.thing].unique().to_pylist()) if self.thing else ())
        count, frame = max(len(names), 1), table["frame"].to_numpy()
        thing = _codes(path, table[self.thing], self.thing, names, self.remedy) if self.thing else np.zeros_like(frame)
        order = np.lexsort((thing, frame))
        self._require_complete(path, frame[order], thing[order], names)
        shape = (-1, count) if self.thing else (-1,)
        columns = {name: column.to_numpy(path, table, self.remedy)[order] for name, column in self.columns.items()}
        arrays: dict[str, Any] = {name: array.reshape(*shape, *array.shape[1:]) for name, array in columns.items()}
        arrays |= {name: table[name].to_numpy()[order[::count]] for name in ("frame", "time_s")}
        own_names = {"names": names} if self.thing and self.names is None else {}
        self._require_times(path, arrays["frame"], arrays["time_s"])
        frames = self.arrays(**arrays, **own_names)
        if not self.agree(frames):
            raise InputError(path, "has rows whose numbers and state disagree", self.remedy)
        return frames

    def _require_times(self, path: Path, frame: np.ndarray, time_s: np.ndarray) -> None:
        """Raise InputError if a frame's number is negative, or the times (n,) do not increase or are out of range."""
        if frame[0] < 0:
            raise InputError(path, f"has the frame {frame[0]}", self.remedy)
        if not (np.isfinite(time_s).all() and (np.diff(time_s) > 0).all()):
            raise InputError(path, "its times do not increase from frame to frame", self.remedy)
        require_seconds(path, time_s)

    def _require_complete(self, path: Path, frame: np.ndarray, thing: np.ndarray, names: Sequence[str]) -> None:
        """Raise InputError unless the sorted rows (r,) have each subject once in every frame."""
        count = max(len(names), 1)
        if not len(frame):
            raise InputError(path, "has no rows", self.remedy)
        if len(frame) % count == 0:
            by_frame = frame.reshape(-1, count)
            whole = (thing.reshape(-1, count) == np.arange(count)).all() and (by_frame == by_frame[:, :1]).all()
            if whole and (np.diff(by_frame[:, 0]) > 0).all():
                return
        rows = f"{len(names)} {self.thing}s" if self.thing else "one row"
        raise InputError(path, f"has frames without exactly {rows}", self.remedy)

    def _arrays(self, frames: Any) -> dict[str, np.ndarray]:
        return {name: np.asarray(getattr(frames, name)) for name in ("frame", "time_s", *self.columns)}

    def _to_table(self, schema: pa.Schema, names: Sequence[str], arrays: dict[str, np.ndarray]) -> pa.Table:
        count = len(names) if self.thing else 1
        columns = [
            pa.array(np.repeat(arrays["frame"].astype(np.int32), count)),
            pa.array(np.repeat(arrays["time_s"].astype(np.float64), count)),
            *([pa.array(list(names) * len(arrays["frame"]), pa.string())] if self.thing else []),
        ]
        for name, column in self.columns.items():
            columns += column.to_arrow(arrays[name])
        return pa.Table.from_arrays(columns, schema=schema)


def _codes(path: Path, column: pa.ChunkedArray, what: str, texts: Sequence[str], remedy: str) -> np.ndarray:
    """Return (n,) int64: the index of each row's text in ``texts``; raises InputError for a text that is not one of
    ``texts``.
    """
    encoded = column.combine_chunks().dictionary_encode()
    found, index = encoded.dictionary.to_pylist(), {text: number for number, text in enumerate(texts)}
    for text in found:
        if text not in index:
            raise InputError(path, f"holds the unknown {what} '{text}'", remedy)
    return np.array([index[text] for text in found], dtype=np.int64)[encoded.indices.to_numpy()]
