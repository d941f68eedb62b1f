"""A table of a results folder of which some frames are read at a time: an hour's need not be in memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import numpy as np
import pyarrow as pa

from anchorpose.errors import InputError
from anchorpose.results.frame_table import FrameTable
from anchorpose.results.parquet import opened_parquet, pieces

Frames = TypeVar("Frames")

_INDEX: Final = ("frame", "time_s")


@dataclass(frozen=True, slots=True, eq=False)
class StoredFrames(Generic[Frames]):
    """frame (n,) int32, time_s (n,) float64; names: of the things in each frame, none where it has one row.

    group_starts (g + 1,): the row at which each row group starts. whole: the table, where its rows are in another order
    than by frame, so that no part of it can be found.
    """

    table: FrameTable[Frames]
    path: Path
    frame: np.ndarray
    time_s: np.ndarray
    names: tuple[str, ...]
    group_starts: np.ndarray
    whole: Frames | None

    def rows(self, first: int, stop: int) -> Frames:
        """The frames from row ``first`` to row ``stop`` of ``frame``.

        Raises InputError where the file is damaged there, or is another one by now.
        """
        if self.whole is not None:
            return _cut(self.whole, len(self.frame), slice(first, stop))
        count = max(len(self.names), 1)
        start, end = first * count, stop * count
        groups = range(
            int(np.searchsorted(self.group_starts, start, side="right")) - 1,
            int(np.searchsorted(self.group_starts, end, side="left")),
        )
        with opened_parquet(self.path, self.table.schema()) as file:
            if file.metadata.num_rows != self.group_starts[-1]:
                raise self._changed()
            some = _between(pieces(file, groups=groups), start - int(self.group_starts[groups[0]]), end - start)
            found = self.table.assemble(self.path, file, some, end - start, self.names)
        if not np.array_equal(found.frame, self.frame[first:stop]):  # type: ignore[attr-defined]
            raise self._changed()
        return found

    def blocks(self, frames: int) -> Iterator[tuple[slice, Frames]]:
        """All frames, so many at a time, with their rows."""
        for first in range(0, len(self.frame), frames):
            rows = slice(first, min(first + frames, len(self.frame)))
            yield rows, self.rows(rows.start, rows.stop)

    def _changed(self) -> InputError:
        return InputError(self.path, "was changed while it was read", "start again")


def open_frames(table: FrameTable[Frames], path: Path) -> StoredFrames[Frames]:
    """Reads the frames' numbers and times only; raises InputError for another table, or one without frames."""
    with opened_parquet(path, table.schema()) as file:
        groups = [file.metadata.row_group(number).num_rows for number in range(file.num_row_groups)]
        names = table.names or (_names_of_first_frame(table, file, groups) if table.thing else ())
        frame, time_s = _index(file, max(len(names), 1))
    if frame is not None:
        return StoredFrames(table, path, frame, time_s, names, np.cumsum([0, *groups]), None)
    whole: Any = table.read(path)
    names = getattr(whole, "names", names)
    return StoredFrames(table, path, whole.frame, whole.time_s, names, np.zeros(1, np.int64), whole)


def _index(file: Any, count: int) -> tuple[np.ndarray | None, np.ndarray]:
    """Number and time of each frame; no numbers where its ``count`` rows do not follow each other in the file."""
    frame, time_s, start = [np.empty(0, np.int32)], [np.empty(0)], 0
    for piece in pieces(file, _INDEX):
        frame.append(piece["frame"].to_numpy())
        time_s.append(piece["time_s"].to_numpy()[-start % count :: count].copy())
        start += len(piece)
    rows = np.concatenate(frame)
    first = rows[::count].copy()
    ordered = len(rows) > 0 and len(rows) % count == 0 and bool((np.diff(first) > 0).all())
    ordered = ordered and all((rows[k::count] == first).all() for k in range(count))
    return first if ordered else None, np.concatenate(time_s)


def _names_of_first_frame(table: FrameTable[Any], file: Any, groups: list[int]) -> tuple[str, ...]:
    """In their order; none where the file has no row."""
    for piece in pieces(file, ("frame", str(table.thing)), groups=range(min(1, len(groups)))):
        own = piece.filter(np.asarray(piece["frame"].to_numpy() == piece["frame"][0].as_py()))
        return tuple(own[table.thing].unique().to_pylist())
    return ()


def _between(some: Iterator[pa.Table], start: int, count: int) -> Iterator[pa.Table]:
    """``count`` rows from row ``start`` on, of pieces that follow each other."""
    for piece in some:
        if start < len(piece) and count > 0:
            part = piece.slice(start, count)
            count -= len(part)
            yield part
        start = max(0, start - len(piece))


def _cut(whole: Frames, count: int, rows: slice) -> Frames:
    """Some frames of a table in memory."""
    arrays = {each.name: getattr(whole, each.name) for each in fields(whole)}  # type: ignore[arg-type]
    cut = {name: array[rows] for name, array in arrays.items() if isinstance(array, np.ndarray) and len(array) == count}
    return replace(whole, **cut)  # type: ignore[type-var]
