"""posture.parquet: where the whole-body centre of mass is estimated to be, and whether the patient is upright."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from anchorpose.results.states import state_codes, state_names
from anchorpose.results.tables import FRAMES_PER_ROW_GROUP, open_parquet, read_parquet

POSTURE_FILE: Final = "posture.parquet"

POSTURE_SCHEMA: Final = pa.schema(
    [
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("time_s", pa.float64(), nullable=False),
        pa.field("com_x_m", pa.float64()),
        pa.field("com_y_m", pa.float64()),
        pa.field("com_z_m", pa.float64()),
        pa.field("com_sigma_m", pa.float64()),
        pa.field("upright", pa.bool_()),
        pa.field("state", pa.string(), nullable=False),
    ]
)

NOT_UPRIGHT, UPRIGHT, UNKNOWN = 0, 1, -1


@dataclass(frozen=True, slots=True, eq=False)
class PostureTable:
    """One row a frame.

    frame (n,) int32, time_s (n,) float64. com_m (n, 3) float64 world, NaN where a joint that it needs is lost;
    com_sigma_m (n,) float64, one standard deviation an axis. upright (n,) int8: 1 yes, 0 no, -1 cannot be told (null in
    the file). state_code (n,) int8 index into ``JointState``: the worst of the joints used.
    """

    frame: np.ndarray
    time_s: np.ndarray
    com_m: np.ndarray
    com_sigma_m: np.ndarray
    upright: np.ndarray
    state_code: np.ndarray


def write_posture(path: Path, posture: PostureTable) -> None:
    """Writes posture.parquet; the same bytes for the same posture."""
    columns = [
        pa.array(posture.frame.astype(np.int32)),
        pa.array(posture.time_s),
        *(pa.array(posture.com_m[:, axis], pa.float64(), from_pandas=True) for axis in range(3)),
        pa.array(posture.com_sigma_m, pa.float64(), from_pandas=True),
        pa.array(posture.upright == UPRIGHT, mask=posture.upright == UNKNOWN),
        pa.array(state_names(posture.state_code), pa.string()),
    ]
    with open_parquet(path, POSTURE_SCHEMA) as writer:
        writer.write_table(pa.Table.from_arrays(columns, schema=POSTURE_SCHEMA), row_group_size=FRAMES_PER_ROW_GROUP)


def read_posture(path: Path) -> PostureTable:
    """A posture.parquet, rows in the order of their frames; raises InputError where it is none."""
    table = read_parquet(path, POSTURE_SCHEMA).sort_by("frame")
    upright = table["upright"].cast(pa.int8()).fill_null(UNKNOWN)
    return PostureTable(
        frame=table["frame"].to_numpy(),
        time_s=table["time_s"].to_numpy(),
        com_m=np.stack([table[f"com_{axis}_m"].to_numpy(zero_copy_only=False) for axis in "xyz"], axis=1),
        com_sigma_m=table["com_sigma_m"].to_numpy(zero_copy_only=False),
        upright=upright.to_numpy(zero_copy_only=False).astype(np.int8),
        state_code=state_codes(path, table["state"]),
    )
