"""A file of another motion capture system, by the ending of its name."""

from __future__ import annotations

from pathlib import Path

from anchorpose.agreement.c3d_file import read_c3d
from anchorpose.agreement.captured import Captured
from anchorpose.agreement.text_files import read_csv, read_mot, read_trc
from anchorpose.errors import InputError


def read_captured(path: Path, unit: str | None = None) -> Captured:
    """Points and angles of a .c3d, .trc, .csv, .mot or .sto; unit: of lengths, where the file does not state it.

    Raises InputError for another ending, and where the file cannot be used.
    """
    match path.suffix.lower():
        case ".c3d":
            return read_c3d(path, unit)
        case ".trc":
            return read_trc(path, unit)
        case ".csv":
            return read_csv(path, unit)
        case ".mot" | ".sto":
            return read_mot(path)
    raise InputError(path, f"ends in '{path.suffix}'", "give a reference as .c3d, .trc, .csv, .mot or .sto")
