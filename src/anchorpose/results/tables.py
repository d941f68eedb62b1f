"""joints.parquet: written frame by frame, the same bytes for the same frames; and read back whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES, LOST, STATE_CODE, JointState
from anchorpose.results.joint_frame import JointFrame

JOINTS_FILE: Final = "joints.parquet"

JOINTS_SCHEMA: Final = pa.schema(
    [
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("time_s", pa.float64(), nullable=False),
        pa.field("joint", pa.string(), nullable=False),
        pa.field("x_m", pa.float64()),
        pa.field("y_m", pa.float64()),
        pa.field("z_m", pa.float64()),
        pa.field("state", pa.string(), nullable=False),
        pa.field("sigma_m", pa.float64()),
    ]
)

Row = TypeVar("Row")

FRAMES_PER_ROW_GROUP: Final = 512
"""Half a megabyte in memory; fixed, since row groups decide the bytes of the file."""


@dataclass(frozen=True, slots=True, eq=False)
class JointTable:
    """All frames of a result. NaN and ``lost`` where a joint has no position.

    frame (n,) int32, time_s (n,) float64, position_m (n, 21, 3) float64 world, state_code (n, 21) int8 index into
    ``JointState``, sigma_m (n, 21) float64.
    """

    frame: np.ndarray
    time_s: np.ndarray
    position_m: np.ndarray
    state_code: np.ndarray
    sigma_m: np.ndarray

    @property
    def lost(self) -> np.ndarray:
        """(n, 21) bool."""
        return self.state_code == LOST


class RowGroups(Generic[Row]):
    """Appends rows to an open parquet file, one row group at a time: memory holds no more."""

    def __init__(self, writer: Any, to_table: Callable[[Sequence[Row]], pa.Table], size: int) -> None:
        self._writer, self._to_table, self._size, self._rows = writer, to_table, size, list[Row]()

    def append(self, row: Row) -> None:
        """Adds one row."""
        self._rows.append(row)
        if len(self._rows) == self._size:
            self.flush()

    def flush(self) -> None:
        """Writes what is held back."""
        if self._rows:
            self._writer.write_table(self._to_table(self._rows))
            self._rows = []


@contextmanager
def write_joints(path: Path) -> Iterator[RowGroups[JointFrame]]:
    """Opens joints.parquet for writing, frame by frame; the file is complete when the block ends without an error."""
    with open_parquet(path, JOINTS_SCHEMA) as writer:
        joints = RowGroups(writer, _to_table, FRAMES_PER_ROW_GROUP)
        yield joints
        joints.flush()


def open_parquet(path: Path, schema: pa.Schema) -> Any:
    """A parquet writer with everything fixed that decides the bytes."""
    return pq.ParquetWriter(path, schema, version="2.6", compression="zstd", compression_level=3)


def read_joints(path: Path) -> JointTable:
    """A joints.parquet, whichever order its rows are in; raises InputError unless every frame has its 21 joints."""
    table = read_parquet(path, JOINTS_SCHEMA)
    columns = {name: table[name].to_numpy(zero_copy_only=False) for name in ("frame", "time_s", "sigma_m")}
    joints = _codes(path, table["joint"], JOINT_INDEX, "joint")
    state_codes = _codes(path, table["state"], {str(state): STATE_CODE[state] for state in JointState}, "state")
    frame, first, row = np.unique(columns["frame"], return_index=True, return_inverse=True)
    seen = np.zeros((len(frame), JOINT_COUNT), dtype=np.int64)
    np.add.at(seen, (row, joints), 1)
    if len(frame) == 0 or (seen != 1).any():
        raise InputError(path, "has no frames, or frames without exactly 21 joints", "track the recording again")
    position_m = np.full((len(frame), JOINT_COUNT, 3), np.nan)
    sigma_m = np.full((len(frame), JOINT_COUNT), np.nan)
    state_code = np.zeros((len(frame), JOINT_COUNT), dtype=np.int8)
    position_m[row, joints] = np.stack([table[axis].to_numpy() for axis in ("x_m", "y_m", "z_m")], axis=1)
    sigma_m[row, joints], state_code[row, joints] = columns["sigma_m"], state_codes
    return JointTable(frame, columns["time_s"][first], position_m, state_code, sigma_m)


def read_parquet(path: Path, schema: pa.Schema, rows: Any = None) -> pa.Table:
    """A table with exactly the columns of ``schema``; raises InputError otherwise. rows: an expression of pyarrow that
    says which rows are read; None for all."""
    try:
        table = pq.read_table(path, filters=rows)
    except FileNotFoundError:
        raise InputError(path, "there is no such file", "give a results folder made by 'anchorpose track'") from None
    except (pa.ArrowException, OSError) as error:
        problem = f"is no parquet table ({str(error).splitlines()[0][:80]})"
        raise InputError(path, problem, "track the recording again") from None
    if table.schema.names != schema.names or table.schema.types != schema.types:
        raise InputError(path, f"its columns are not {', '.join(schema.names)}", "track the recording again")
    return table


def _to_table(frames: Sequence[JointFrame]) -> pa.Table:
    position = np.concatenate([frame.position_m for frame in frames])
    sigma = np.concatenate([frame.sigma_m for frame in frames])
    columns = [
        pa.array(np.repeat(np.array([frame.frame for frame in frames], dtype=np.int32), JOINT_COUNT)),
        pa.array(np.repeat(np.array([frame.time_s for frame in frames], dtype=np.float64), JOINT_COUNT)),
        pa.array(JOINT_NAMES * len(frames), pa.string()),
        *(pa.array(position[:, axis], pa.float64(), from_pandas=True) for axis in range(3)),  # NaN becomes null
        pa.array([str(state) for frame in frames for state in frame.state], pa.string()),
        pa.array(sigma, pa.float64(), from_pandas=True),
    ]
    return pa.Table.from_arrays(columns, schema=JOINTS_SCHEMA)


def _codes(path: Path, column: pa.ChunkedArray, code_of: dict[str, int], what: str) -> np.ndarray:
    encoded = column.combine_chunks().dictionary_encode()
    names = encoded.dictionary.to_pylist()
    for name in names:
        if name not in code_of:
            raise InputError(path, f"holds the unknown {what} '{name}'", "track the recording again")
    codes = np.array([code_of[name] for name in names], dtype=np.int64)
    return codes[encoded.indices.to_numpy()]
