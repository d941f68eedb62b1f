"""angles_processed.parquet: angles of joints that were smoothed or whose gaps were filled, every row marked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from anchorpose.errors import InputError
from anchorpose.results.angles import ANGLES_SCHEMA, AngleTable, angle_columns, angles_of, row_groups
from anchorpose.results.tables import open_parquet, read_parquet

PROCESSED_FILE: Final = "angles_processed.parquet"

PROCESSED_SCHEMA: Final = ANGLES_SCHEMA.append(pa.field("processing", pa.string(), nullable=False))

PROCESSING: Final = ("measured", "smoothed", "filled")
"""What was done to an angle's joints, the worst of them; the codes of ``ProcessedAngles.processing``."""

POLICY_KEY: Final = "processing_policy"


@dataclass(frozen=True, slots=True, eq=False)
class ProcessedAngles:
    """angles, processing (n, a) int8 index into ``PROCESSING``, and the policy as a JSON text."""

    angles: AngleTable
    processing: np.ndarray
    policy: str


def write_processed_angles(path: Path, processed: ProcessedAngles) -> None:
    """Writes angles_processed.parquet with the policy in its schema's metadata; the same bytes for the same angles."""
    schema = PROCESSED_SCHEMA.with_metadata({POLICY_KEY: processed.policy})
    names = np.array(PROCESSING, dtype=object)
    with open_parquet(path, schema) as writer:
        for rows in row_groups(len(processed.angles.frame)):
            marks = pa.array(names[processed.processing[rows].ravel()], pa.string())
            columns = [*angle_columns(processed.angles, rows), marks]
            writer.write_table(pa.Table.from_arrays(columns, schema=schema))


def read_processed_angles(path: Path) -> ProcessedAngles:
    """An angles_processed.parquet; raises InputError where it is none or does not say what was done."""
    table = read_parquet(path, PROCESSED_SCHEMA)
    policy, marks = (table.schema.metadata or {}).get(POLICY_KEY.encode()), table["processing"].to_pylist()
    if policy is None or not set(marks) <= set(PROCESSING):
        remedy = "run 'anchorpose measure' on its folder again"
        raise InputError(path, "does not say how its angles were smoothed and filled", remedy)
    angles = angles_of(path, table)
    codes = np.array([PROCESSING.index(mark) for mark in marks], dtype=np.int8)
    return ProcessedAngles(angles, codes.reshape(angles.degrees.shape), policy.decode())
