"""Numbers of other programs' files: finite ones, or None."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.document import read_text


def finite(value: Any) -> float | None:
    """A finite number of a JSON file; None for anything else."""
    number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300
    return float(value) if number and math.isfinite(value) else None


def finite_list(value: Any, count: int) -> list[float] | None:
    """A list of so many finite numbers; None for anything else."""
    if not isinstance(value, list) or len(value) != count:
        return None
    numbers = [number for cell in value if (number := finite(cell)) is not None]
    return numbers if len(numbers) == count else None


def read_matrix(path: Path, rows: int, columns: int) -> np.ndarray:
    """(rows, columns) float64 of a text file, separated by spaces or commas; raises InputError."""
    try:
        cells = [line.replace(",", " ").split() for line in read_text(path).splitlines() if line.strip()]
        matrix = np.array(cells, dtype=np.float64)
    except ValueError:
        matrix = np.empty(0)
    if matrix.shape != (rows, columns) or not np.isfinite(matrix).all():
        raise InputError(path, f"is not a matrix of {rows} x {columns} numbers", "export it again")
    return matrix
