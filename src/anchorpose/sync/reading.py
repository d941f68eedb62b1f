"""Read the file of another device, by its ending."""

from __future__ import annotations

from pathlib import Path

from anchorpose.errors import InputError
from anchorpose.sync.csv_file import read_csv
from anchorpose.sync.streams import OtherFile


def read_other(path: Path, time_column: str | None = None) -> OtherFile:
    """Signals of a .csv; time_column as of ``read_csv``. Raises InputError for another ending."""
    match path.suffix.lower():
        case ".csv":
            return read_csv(path, time_column)
    raise InputError(path, f"ends in '{path.suffix}'", "give a .csv")
