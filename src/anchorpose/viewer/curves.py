"""angles.parquet as curves, whichever angles it holds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JointState
from anchorpose.results.angles import ANGLES_SCHEMA
from anchorpose.results.joint_frame import LOST, SEVERITY
from anchorpose.results.tables import read_parquet


@dataclass(frozen=True, slots=True, eq=False)
class AngleCurves:
    """degrees and sigma_deg (n, a) float32, NaN where unknown; severity (n, a) uint8 of ``JointState``."""

    names: tuple[str, ...]
    degrees: np.ndarray
    sigma_deg: np.ndarray
    severity: np.ndarray


def read_curves(path: Path, frame: np.ndarray) -> AngleCurves:
    """Every angle of the table on the frames (n,) of the results; a frame that it does not have is lost."""
    table = read_parquet(path, ANGLES_SCHEMA)
    names = tuple(dict.fromkeys(table["angle"].to_pylist()))
    column_of, row_of = {name: i for i, name in enumerate(names)}, {int(number): i for i, number in enumerate(frame)}
    try:
        row = np.array([row_of[number] for number in table["frame"].to_pylist()], dtype=np.int64)
    except KeyError as error:
        problem = f"has the frame {error.args[0]}, which the joints do not have"
        raise InputError(path, problem, "track the recording again") from None
    column = np.array([column_of[name] for name in table["angle"].to_pylist()], dtype=np.int64)
    code = {str(state): SEVERITY[state] for state in JointState}
    shape = len(frame), len(names)
    curves = AngleCurves(
        names, np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32), np.full(shape, LOST, np.uint8)
    )
    curves.degrees[row, column] = table["degrees"].to_numpy(zero_copy_only=False)
    curves.sigma_deg[row, column] = table["sigma_deg"].to_numpy(zero_copy_only=False)
    curves.severity[row, column] = [code.get(state, LOST) for state in table["state"].to_pylist()]
    return curves
