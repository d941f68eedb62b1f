"""Tables with the same named things in every frame, one row each: to columns, and back to arrays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from anchorpose.errors import InputError
from anchorpose.results.tables import read_parquet


def rows_schema(kind: str, numbers: Sequence[str], number: pa.DataType) -> pa.Schema:
    """``frame``, ``time_s``, the name of the thing in a column called ``kind``, and its numbers, which may be null."""
    return pa.schema(
        [
            pa.field("frame", pa.int32(), nullable=False),
            pa.field("time_s", pa.float64(), nullable=False),
            pa.field(kind, pa.string(), nullable=False),
            *(pa.field(name, number) for name in numbers),
        ]
    )


def to_rows(
    schema: pa.Schema, names: Sequence[str], frame: Sequence[int], time_s: Sequence[float], values: np.ndarray
) -> pa.Table:
    """values (n, len(names), numbers) of the frames (n,); NaN becomes null."""
    flat = values.reshape(-1, values.shape[-1])
    columns = [
        pa.array(np.repeat(np.array(frame, np.int32), len(names))),
        pa.array(np.repeat(np.array(time_s, np.float64), len(names))),
        pa.array(list(names) * len(frame), pa.string()),
        *(pa.array(flat[:, number], schema.types[3 + number], from_pandas=True) for number in range(flat.shape[1])),
    ]
    return pa.Table.from_arrays(columns, schema=schema)


def from_rows(path: Path, schema: pa.Schema, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """frame (n,) int32, time_s (n,) and values (n, len(names), numbers), null as NaN.

    Raises InputError unless every frame has all the names, in their order.
    """
    table, count, kind = read_parquet(path, schema), len(names), schema.names[2]
    frames, left = divmod(len(table), count)
    if left or table[kind].to_pylist() != list(names) * frames:
        raise InputError(path, f"has frames without exactly one row for each {kind}", "track the recording again")
    numbers = np.stack([table[name].to_numpy(zero_copy_only=False) for name in schema.names[3:]], axis=1)
    return table["frame"].to_numpy()[::count], table["time_s"].to_numpy()[::count], numbers.reshape(frames, count, -1)
