"""Read the minimal detectable change of each measure, as 'anchorpose reliability' wrote it from repeated sessions."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.recording.document import read_rows, require_distinct

Detectable = dict[tuple[str, str | None, str], float]
"""The minimal detectable change (MDC95) by measure, side and unit. Errors of measurement and day-to-day variation alone
cause a larger change only 5 times in 100.
"""

RELIABILITY_COLUMNS: Final = ("measure", "side", "unit", "mdc95")
RELIABILITY_REMEDY: Final = "give the table that 'anchorpose reliability SESSIONS.csv -o FILE.csv' writes"


def read_detectable(path: Path) -> Detectable:
    """Read the minimal detectable changes in a table. Raises InputError if the file is another table or states no
    change.
    """
    lines = [line for _, line in read_rows(path)]
    head = lines[0] if lines else []
    require_distinct(path, head)
    found: Detectable = {}
    for row in (dict(zip(head, line, strict=False)) for line in lines[1:]):
        if any(row.get(name) is None for name in RELIABILITY_COLUMNS):
            raise InputError(
                path, f"does not have the columns {', '.join(RELIABILITY_COLUMNS)} in all rows", RELIABILITY_REMEDY
            )
        if row["mdc95"]:
            found[row["measure"], row["side"] or None, row["unit"]] = _threshold(path, row["mdc95"])
    if not found:
        raise InputError(path, "holds no minimal detectable change", RELIABILITY_REMEDY)
    return found


def _threshold(path: Path, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise InputError(path, f"has the minimal detectable change '{text}'", RELIABILITY_REMEDY)
    return value
