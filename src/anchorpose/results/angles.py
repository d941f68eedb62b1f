"""angles.parquet: joint angles over time, written and read; ``kinematics`` says what they are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from anchorpose.errors import InputError
from anchorpose.results.states import state_codes, state_names
from anchorpose.results.tables import FRAMES_PER_ROW_GROUP, open_parquet, read_parquet

ANGLES_FILE: Final = "angles.parquet"

ANGLES_SCHEMA: Final = pa.schema(
    [
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("time_s", pa.float64(), nullable=False),
        pa.field("angle", pa.string(), nullable=False),
        pa.field("degrees", pa.float64()),
        pa.field("state", pa.string(), nullable=False),
        pa.field("sigma_deg", pa.float64()),
    ]
)


@dataclass(frozen=True, slots=True, eq=False)
class AngleTable:
    """frame (n,) int32, time_s (n,) float64, names (a,) of docs/angles.md.

    degrees and sigma_deg (n, a) float64, NaN where a joint is lost or the pose leaves the angle undetermined;
    state_code (n, a) int8 index into ``JointState``, the worst of the joints involved.
    """

    frame: np.ndarray
    time_s: np.ndarray
    names: tuple[str, ...]
    degrees: np.ndarray
    state_code: np.ndarray
    sigma_deg: np.ndarray

    def column(self, name: str) -> int:
        """Which of the second axis is the angle ``name``; raises ValueError where there is none."""
        return self.names.index(name)


def write_angles(path: Path, angles: AngleTable) -> None:
    """Writes angles.parquet, one row an angle and frame; the same bytes for the same angles."""
    with open_parquet(path, ANGLES_SCHEMA) as writer:
        for rows in row_groups(len(angles.frame)):
            writer.write_table(pa.Table.from_arrays(angle_columns(angles, rows), schema=ANGLES_SCHEMA))


def read_angles(path: Path) -> AngleTable:
    """An angles.parquet; raises InputError unless every frame has the same angles in the same order."""
    return angles_of(path, read_parquet(path, ANGLES_SCHEMA))


def row_groups(frames: int) -> list[slice]:
    """Frames that are written together; fixed, since they decide the bytes of the file."""
    return [slice(start, start + FRAMES_PER_ROW_GROUP) for start in range(0, frames, FRAMES_PER_ROW_GROUP)]


def angle_columns(angles: AngleTable, rows: slice) -> list[pa.Array]:
    """The columns of ``ANGLES_SCHEMA`` of some frames."""
    count = len(angles.frame[rows])
    return [
        pa.array(np.repeat(angles.frame[rows].astype(np.int32), len(angles.names))),
        pa.array(np.repeat(angles.time_s[rows], len(angles.names))),
        pa.array(angles.names * count, pa.string()),
        pa.array(angles.degrees[rows].ravel(), pa.float64(), from_pandas=True),
        pa.array(state_names(angles.state_code[rows].ravel()), pa.string()),
        pa.array(angles.sigma_deg[rows].ravel(), pa.float64(), from_pandas=True),
    ]


def angles_of(path: Path, table: pa.Table) -> AngleTable:
    """What a table holds that begins with the columns of ``ANGLES_SCHEMA``; path: whom to blame."""
    frame, first = np.unique(table["frame"].to_numpy(), return_index=True)
    each = len(table) // max(len(frame), 1)
    shape = (len(frame), each)
    names = tuple(table["angle"].slice(0, each).to_pylist())
    if not each or len(set(names)) < each or table["angle"].to_pylist() != list(names) * len(frame):
        remedy = "run 'anchorpose measure' on its folder again"
        raise InputError(path, "has no frames, or frames with different angles", remedy)
    return AngleTable(
        frame=frame,
        time_s=table["time_s"].to_numpy()[first],
        names=names,
        degrees=table["degrees"].to_numpy().reshape(shape),
        state_code=state_codes(path, table["state"]).reshape(shape),
        sigma_deg=table["sigma_deg"].to_numpy().reshape(shape),
    )
