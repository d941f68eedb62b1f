"""Make the table of a run: one row per scene class, and the differences with intervals if two versions ran."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from intervals import paired_difference
from remarks import ALL_REMARKS, NOTHING, REMARKS, Measured, Remark, known_values, values_of


@dataclass(frozen=True, slots=True)
class Column:
    """A score that has a column of its own. scale: factor of the score; worst: function that chooses, from the
    recordings' values, the one in brackets."""

    name: str
    title: str
    scale: float = 1.0
    digits: int = 1
    worst: Callable[[np.ndarray], float] | None = None
    align: ClassVar[str] = "--:"

    def cell(self, measured: Measured) -> str:
        """Return the mean over the recordings, with the worst in brackets."""
        known = self.scale * known_values(self.name, measured)
        if not known.size:
            return NOTHING
        worst = "" if self.worst is None or known.size < 2 else f" ({self.worst(known):.{self.digits}f})"
        return f"{known.mean():.{self.digits}f}{worst}"


COLUMNS: Final = (
    Column("mean_mm", "mean mm", worst=np.max),
    Column("p95_mm", "95 % mm"),
    Column("hidden_mm", "hidden mm"),
    Column("confident", "confident errors %", 100.0, 2),
    Column("cover_seen", "coverage seen", digits=2),
    Column("cover_hidden", "coverage hidden", digits=2),
    Column("lost", "lost %", 100.0),
    Column("frame_ms", "ms a frame", digits=0, worst=np.max),
    Column("start_s", "start s", digits=1),
    Column("peak_mb", "MB", digits=0, worst=np.max),
)
PAIRED: Final = (
    *COLUMNS,
    Column("right", "right %", 100.0),
    Column("within_100", "in 100 mm %", 100.0),
    Column("tilt_deg", "tilt deg"),
    Column("precision", "precision", digits=2),
    Column("recall", "recall", digits=2),
)
OTHERWISE_SHOWN: Final = frozenset({"trials", "refused"})  # in the column ``also``
WORSE_IF_LARGER: Final = ("_mm", "_deg", "_ms", "error")  # endings of the names of probes' scores


def columns_of(rows: Mapping[str, Measured], known: Sequence[Column]) -> Sequence[Column]:
    """Return the columns ``known``. If the rows have no score of ``COLUMNS``, as those of most probes, return one
    column for each of their scores.
    """
    names = dict.fromkeys(name for measured in rows.values() for one in measured for name in one)
    if not names or not {column.name for column in COLUMNS}.isdisjoint(names):
        return known
    own = {column.name: column for column in PAIRED}
    return tuple(own.get(name) or _column(name, rows) for name in names if name not in OTHERWISE_SHOWN)


def _column(name: str, rows: Mapping[str, Measured]) -> Column:
    """Return the column of a probe's score: counts and whole percentages without decimals."""
    values = np.concatenate([known_values(name, measured) for measured in rows.values()])
    whole = values.max(initial=0.0) > 1.0 and bool((values == values.round()).all())
    digits = 0 if whole else 1 if name.endswith(("_mm", "_percent")) else 2
    worst = np.max if name.endswith(WORSE_IF_LARGER) else None
    return Column(name, name.replace("_percent", " %").replace("_", " "), digits=digits, worst=worst)


def table(rows: Mapping[str, Measured], names: Sequence[str] = ()) -> str:
    """Return Markdown with the number of recordings, the mean of each score with the worst in brackets, and remarks.

    names: the columns and remarks to show instead of all. Raises KeyError for a name without a measured score.
    """
    shown = [_named(name, rows) for name in names] or [*columns_of(rows, COLUMNS), ALL_REMARKS]
    titles = ["scene", "recordings", *(one.title for one in shown)]
    lines = [f"| {' | '.join(titles)} |", "|---|--:|" + "".join(f"{one.align}|" for one in shown)]
    for row, measured in rows.items():
        lines.append(f"| {' | '.join((row, str(sum(map(bool, measured))), *(one.cell(measured) for one in shown)))} |")
    return "\n".join(lines)


def _named(name: str, rows: Mapping[str, Measured]) -> Column | Remark:
    """Return the remark of this name, the known column, or a new column for the score."""
    remark = next((one for one in REMARKS if one.name == name), None)
    if not any(remark.words(of) if remark else any(name in one for one in of) for of in rows.values()):
        raise KeyError(f"no {name} was measured")
    return remark or next((one for one in PAIRED if one.name == name), None) or _column(name, rows)


def differences(now: Mapping[str, Measured], before: Mapping[str, Measured], title: str) -> str:
    """Return Markdown: mean and 95 % interval of ``now`` less ``before``, whose rows have the same recordings in the
    same order. Recordings for which only one of them has a score are left out.
    """
    columns = columns_of(now, PAIRED)
    titles = ["scene", *(column.title for column in columns)]
    lines = [f"Now less {title}:", "", f"| {' | '.join(titles)} |", "|---|" + "--:|" * len(columns)]
    for row, measured in now.items():
        cells = [_difference(column, measured, before.get(row, ())) for column in columns]
        lines.append(f"| {row} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _difference(column: Column, now: Measured, before: Measured) -> str:
    if len(now) != len(before):
        return NOTHING
    found = paired_difference(*(column.scale * values_of(column.name, measured) for measured in (now, before)))
    if found is None:
        return NOTHING
    digits = column.digits
    bounds = "" if found.low is None else f" ({found.low:+.{digits}f} to {found.high:+.{digits}f})"
    return f"{found.mean:+.{digits}f}{bounds}"
