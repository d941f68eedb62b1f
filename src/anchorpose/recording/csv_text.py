"""CSV files: rows of a file that a user gives, and texts of users in files that the program writes."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.recording.document import read_text
from anchorpose.recording.regular_file import LARGEST_TABLE

FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")
"""First characters at which a spreadsheet takes a cell for a formula."""


def read_rows(path: Path) -> list[tuple[int, list[str]]]:
    """Return (number of the last line, cells without spaces around them) of each row that is not empty.

    Raises InputError where the file cannot be read, or is not CSV.
    """
    text = read_text(path, LARGEST_TABLE)
    if "\0" in text:
        raise InputError(path, "holds null characters", "save it again as CSV in UTF-8")
    rows = csv.reader(StringIO(text, newline=""))
    try:
        found = [(rows.line_num, [cell.strip() for cell in row]) for row in rows]
    except csv.Error as error:
        raise InputError(path, f"is not CSV in line {rows.line_num} ({error})", "correct that line") from None
    return [(number, row) for number, row in found if any(row)]


def require_distinct(path: Path, columns: Sequence[str]) -> None:
    """Raise InputError where two columns have one name."""
    repeated = next((name for name, count in Counter(columns).items() if count > 1 and name), None)
    if repeated is not None:
        raise InputError(path, f"has two columns '{repeated[:40]}'", "keep one of them")


def cell_text(cell: object) -> str:
    """Return a cell as text: empty for None, all digits of a float, and an apostrophe before a text that a spreadsheet
    would run as a formula."""
    if cell is None:
        return ""
    text = repr(float(cell)) if isinstance(cell, float) else str(cell)
    return f"'{text}" if text.startswith(FORMULA) and not _is_number(text) else text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
