"""Read the file of another device; the ending of its name states the format."""

from __future__ import annotations

from pathlib import Path

from anchorpose.errors import InputError
from anchorpose.sync.csv_file import read_csv
from anchorpose.sync.edf_file import read_edf
from anchorpose.sync.streams import OtherFile
from anchorpose.sync.xdf_file import read_xdf


def read_other(path: Path, time_column: str | None = None) -> OtherFile:
    """Read the signals of a .csv, .xdf, .edf or .bdf file; time_column: as in ``read_csv``. Raises InputError for other
    endings.
    """
    ending = path.suffix.lower()
    if time_column is not None and ending != ".csv":
        raise InputError(path, "is not a CSV", "leave out --time")
    match ending:
        case ".csv":
            return read_csv(path, time_column)
        case ".xdf":
            return read_xdf(path)
        case ".edf" | ".bdf":
            return read_edf(path)
    raise InputError(path, f"ends in '{path.suffix}'", "give a .csv, .xdf, .edf or .bdf")
