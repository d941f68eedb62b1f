"""anchors.parquet: head, hands and feet as the surface showed them, each found or missed; witnesses, not joints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from anchorpose.errors import InputError
from anchorpose.geodesics.anchors import ANCHOR_NAMES
from anchorpose.results.tables import FRAMES_PER_ROW_GROUP, RowGroups, open_parquet, read_parquet

ANCHORS_FILE: Final = "anchors.parquet"

_NUMBERS: Final = ("x_m", "y_m", "z_m", "sigma_m")

ANCHORS_SCHEMA: Final = pa.schema(
    [
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("time_s", pa.float64(), nullable=False),
        pa.field("anchor", pa.string(), nullable=False),
        *(pa.field(name, pa.float64()) for name in _NUMBERS),
    ]
)


@dataclass(frozen=True, slots=True, eq=False)
class AnchorFrame:
    """position_m (5, 3) world and sigma_m (5,), order of ``ANCHOR_NAMES``, NaN where missed."""

    frame: int
    time_s: float
    position_m: np.ndarray
    sigma_m: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class AnchorTable:
    """All frames: frame (n,) int32, time_s (n,), position_m (n, 5, 3), sigma_m (n, 5) float64, NaN where missed."""

    frame: np.ndarray
    time_s: np.ndarray
    position_m: np.ndarray
    sigma_m: np.ndarray


@contextmanager
def write_anchors(path: Path) -> Iterator[RowGroups[AnchorFrame]]:
    """Opens anchors.parquet for writing, frame by frame; the same bytes for the same frames."""
    with open_parquet(path, ANCHORS_SCHEMA) as writer:
        anchors = RowGroups(writer, _to_table, FRAMES_PER_ROW_GROUP)
        yield anchors
        anchors.flush()


def read_anchors(path: Path) -> AnchorTable:
    """An anchors.parquet; raises InputError unless every frame has its five anchors, in their order."""
    table, count = read_parquet(path, ANCHORS_SCHEMA), len(ANCHOR_NAMES)
    frames, left = divmod(len(table), count)
    if left or table["anchor"].to_pylist() != list(ANCHOR_NAMES) * frames:
        raise InputError(path, f"has frames without exactly {count} anchors", "track the recording again")
    numbers = np.stack([table[name].to_numpy(zero_copy_only=False) for name in _NUMBERS], axis=1)
    numbers = numbers.reshape(frames, count, len(_NUMBERS))
    return AnchorTable(
        frame=table["frame"].to_numpy()[::count],
        time_s=table["time_s"].to_numpy()[::count],
        position_m=numbers[..., :3],
        sigma_m=numbers[..., 3],
    )


def _to_table(frames: Sequence[AnchorFrame]) -> pa.Table:
    count = len(ANCHOR_NAMES)
    numbers = np.concatenate([np.column_stack([frame.position_m, frame.sigma_m]) for frame in frames])
    columns = [
        pa.array(np.repeat(np.array([frame.frame for frame in frames], np.int32), count)),
        pa.array(np.repeat(np.array([frame.time_s for frame in frames], np.float64), count)),
        pa.array(ANCHOR_NAMES * len(frames), pa.string()),
        *(pa.array(numbers[:, column], pa.float64(), from_pandas=True) for column in range(len(_NUMBERS))),
    ]
    return pa.Table.from_arrays(columns, schema=ANCHORS_SCHEMA)
