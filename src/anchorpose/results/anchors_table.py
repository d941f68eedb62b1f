"""anchors.parquet: head, hands and feet as the surface showed them, each found or missed; witnesses, not joints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from anchorpose.geodesics.anchors import ANCHOR_NAMES
from anchorpose.results.frame_rows import from_rows, rows_schema, to_rows
from anchorpose.results.tables import FRAMES_PER_ROW_GROUP, RowGroups, open_parquet

ANCHORS_FILE: Final = "anchors.parquet"

ANCHORS_SCHEMA: Final = rows_schema("anchor", ("x_m", "y_m", "z_m", "sigma_m"), pa.float64())


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
    frame, time_s, numbers = from_rows(path, ANCHORS_SCHEMA, ANCHOR_NAMES)
    return AnchorTable(frame, time_s, numbers[..., :3], numbers[..., 3])


def _to_table(frames: Sequence[AnchorFrame]) -> pa.Table:
    numbers = np.stack([np.column_stack([frame.position_m, frame.sigma_m]) for frame in frames])
    return to_rows(ANCHORS_SCHEMA, ANCHOR_NAMES, [f.frame for f in frames], [f.time_s for f in frames], numbers)
