"""Minimal detectable changes from a table of ``anchorpose reliability``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.recording.document import read_rows, require_distinct

Detectable = dict[tuple[str, str | None, str], float]
"""By measure, side and unit: the least change that errors and days alone exceed 5 times in 100."""

COLUMNS: Final = ("measure", "side", "unit", "mdc95")
REMEDY: Final = "give the table that 'anchorpose reliability SESSIONS.csv -o FILE.csv' writes"


def read_detectable(path: Path) -> Detectable:
    """The measures that have a value; raises InputError for another table."""
    lines = [line for _, line in read_rows(path)]
    head = lines[0] if lines else []
    require_distinct(path, head)
    found: Detectable = {}
    for row in (dict(zip(head, line, strict=False)) for line in lines[1:]):
        if any(row.get(name) is None for name in COLUMNS):
            raise InputError(path, f"does not have the columns {', '.join(COLUMNS)} in all rows", REMEDY)
        if row["mdc95"]:
            found[row["measure"], row["side"] or None, row["unit"]] = _change(path, row["mdc95"])
    if not found:
        raise InputError(path, "holds no minimal detectable change", REMEDY)
    return found


def _change(path: Path, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise InputError(path, f"has the minimal detectable change '{text}'", REMEDY)
    return value
