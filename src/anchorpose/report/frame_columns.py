"""Columns of tables that are in memory as arrays, as they are in the file: an hour's are not read a second time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from anchorpose.results.frame_table import Codes, FrameTable, Numbers


@dataclass(frozen=True, slots=True, eq=False)
class FrameColumns:
    """frames: what ``table`` has read, in the order of the file: by frame, then by thing."""

    table: FrameTable[Any]
    frames: Any

    def values(self, name: str, where: tuple[tuple[str, str | None], ...]) -> pa.Array | None:
        """A column of the rows in which each column of ``where`` has that value, null where it is unknown.

        None for other conditions than on the thing that a row is about, and for columns that are not numbers or codes.
        """
        chosen: Any = slice(None)
        if where:
            things = self._things
            ((column, value), *more) = where
            if more or column != self.table.thing or value not in things:
                return None
            chosen = things.index(value)
        if name == "frame":
            count = 1 if where or self.table.thing is None else len(self._things)
            return pa.array(np.repeat(self.frames.frame, count))
        for attribute, kind in self.table.columns.items():
            array = getattr(self.frames, attribute)
            array = array if self.table.thing is None else array[:, chosen]
            if isinstance(kind, Numbers) and name in kind.names:
                some = array if len(kind.names) == 1 else array[..., kind.names.index(name)]
                return pa.array(some.ravel(), kind.type, from_pandas=True)
            if isinstance(kind, Codes) and name == kind.name:
                return pa.DictionaryArray.from_arrays(pa.array(array.ravel()), pa.array(kind.texts))
        return None

    @property
    def _things(self) -> tuple[str, ...]:
        names: tuple[str, ...] = self.frames.names if self.table.names is None else self.table.names
        return names
