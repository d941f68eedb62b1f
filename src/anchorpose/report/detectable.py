"""Read the minimal detectable change of each measure, as 'anchorpose reliability' wrote it from repeated sessions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.recording.document import read_rows, require_distinct
from anchorpose.report.words import listed
from anchorpose.results.records import Measure

Detectable = dict[tuple[str, str | None, str], float]
"""The minimal detectable change (MDC95) by measure, side and unit. Errors of measurement and day-to-day variation alone
cause a larger change only 5 times in 100.
"""

RELIABILITY_COLUMNS: Final = ("measure", "side", "unit", "mdc95")
RELIABILITY_REMEDY: Final = "give the table that 'anchorpose reliability SESSIONS.csv -o FILE.csv' writes"


def read_detectable(path: Path, measures: Iterable[Measure]) -> Detectable:
    """Read the minimal detectable changes from a table of ``anchorpose reliability``. measures: the sessions' measures,
    to which the minimal detectable changes are applied.

    Raises InputError if the file is not such a table, if it states no minimal detectable change, or if it has a measure
    of the sessions, but for a side or unit that the sessions do not have.
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
    _require_matching(path, found, {(m.measure, m.side, m.unit) for m in measures if not (m.part or m.person)})
    return found


def _require_matching(path: Path, found: Detectable, known: set[tuple[str, str | None, str]]) -> None:
    for name, side, unit in found:
        wanted = sorted({_named(s, u) for measure, s, u in known if measure == name})
        if wanted and (name, side, unit) not in known:
            problem = f"has {name} {_named(side, unit)}, but the sessions have it as {listed(wanted)}"
            remedy = "write the columns side and unit into the table of sessions and run 'anchorpose reliability' again"
            raise InputError(path, problem, remedy)


def _named(side: str | None, unit: str) -> str:
    return f"({side or 'no side'}, {unit or 'no unit'})"


def _threshold(path: Path, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise InputError(path, f"has the minimal detectable change '{text}'", RELIABILITY_REMEDY)
    return value
