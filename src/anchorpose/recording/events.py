"""Read events.tsv, the list of a recording's trials with their conditions, and events.json, which gives the units of
the columns.

The format is the events format of BIDS: onset and duration in seconds, trial_type, then the user's own columns. Onsets
count from the first frame of the first camera in recording.json, even if this camera measured nothing. Neither the
value of this camera's clock nor a later start of tracking changes the onsets. A trial is one row; trials are numbered
from 1 in the order of the file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Final

import numpy as np
from pydantic import AfterValidator, Field

from anchorpose.errors import InputError
from anchorpose.options import plain_number
from anchorpose.recording.document import Entry, read_json, read_rows, require_distinct, validate
from anchorpose.recording.recording import Recording
from anchorpose.recording.regular_file import is_there
from anchorpose.settings import LARGEST, Unfit

EVENTS_FILE: Final = "events.tsv"
REQUIRED: Final = ("onset", "duration", "trial_type")
MISSING: Final = "n/a"

GIVEN: Final = "--events "
"""In the list of a run's inputs with hashes, this prefix marks an events file that the user gave with this option."""

LARGEST_EVENTS: Final = 4 * 2**20
"""Maximum size of an events.tsv in bytes: a session has some hundred trials, of a hundred bytes each."""

MOST_TRIALS: Final = 2000
MOST_COLUMNS: Final = 100
LONGEST_TEXT: Final = 200
"""Maximum length in characters of a column's name or of a cell."""

ROUNDING_S: Final = 0.001
"""Maximum time in s by which trials may overlap or exceed the recording: times are often rounded to the ms."""

BLOCK_COLUMN: Final = "block"
"""Column with each trial's block: a group of trials in which the order of conditions was drawn at random."""

UNITS: Final = (
    *("s", "ms", "us", "min", "Hz", "kHz", "mA", "uA", "A", "V", "mV", "uC", "W"),
    *("deg", "mm", "cm", "m", "m/s", "kg", "N", "Nm", "%", "bpm", "mmHg", "degC", "count", "score", "1", "arbitrary"),
)
"""Units that a numeric column may have: ``1`` for a dimensionless number, and ``arbitrary`` for a device's own
scale.
"""

_SPELLINGS: Final = {"µs": "us", "μs": "us", "µA": "uA", "μA": "uA", "µC": "uC", "μC": "uC", "°": "deg", "°C": "degC"}

RESERVED: Final = frozenset(
    (
        *("trial", "condition", "onset_s", "duration_s", "start_s", "end_s", "measure", "side", "part", "person"),
        *("value", "unit", "sigma", "frames", "inferred_share", "why", "state"),
    )
)
"""Names that the user's columns may not have, since results and exports use them."""


@dataclass(frozen=True, slots=True)
class TrialColumn:
    """A column of events.tsv that the user added. unit: one of ``UNITS``; None for a column of texts."""

    name: str
    unit: str | None
    description: str = ""


@dataclass(frozen=True, slots=True)
class Trial:
    """One row of events.tsv.

    number: from 1, in the order of the file. condition: the trial_type. onset_s: time since the recording's first
    frame. start_s, end_s: on the clock of the first camera; a frame at start_s belongs to the trial, a frame at end_s
    does not. cells: for each ``TrialColumn`` a number, a text, or None if empty.
    """

    number: int
    condition: str
    onset_s: float
    duration_s: float
    start_s: float
    cells: tuple[float | str | None, ...] = ()

    @property
    def end_s(self) -> float:
        """Return the time in s at which the trial ended, on the clock of the first camera."""
        return self.start_s + self.duration_s


@dataclass(frozen=True, slots=True)
class Trials:
    """All trials of a recording in the order of the file, at least one.

    reference: the condition with which the other conditions are compared; None: the condition of the first trial.
    """

    columns: tuple[TrialColumn, ...]
    rows: tuple[Trial, ...]
    reference: str | None = None

    @property
    def conditions(self) -> tuple[str, ...]:
        """Return each condition once: first the reference, then the others in the order of their first trials."""
        named = () if self.reference is None else (self.reference,)
        return tuple(dict.fromkeys((*named, *(trial.condition for trial in self.rows))))

    def column(self, name: str) -> tuple[float | str | None, ...]:
        """Return the cells of a column, one per trial; raises ValueError for an unknown column."""
        place = [column.name for column in self.columns].index(name)
        return tuple(trial.cells[place] for trial in self.rows)


@dataclass(frozen=True, slots=True)
class RecordedSpan:
    """Start and end of a recording, seconds on the clock of its first camera. The end is the time of the last frame
    plus the usual interval between frames. first_s is None if the start is unknown, because the first camera
    was left out and its times do not overlap with the times of the frames.
    """

    first_s: float | None
    end_s: float


def recorded_span(time_s: np.ndarray) -> RecordedSpan:
    """Return the span of all frames (n,) of the first camera, tracked or not; a single frame has no duration."""
    step_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    return RecordedSpan(float(time_s[0]), float(time_s[-1]) + step_s)


def span_of(recording: Recording) -> RecordedSpan:
    """Return the span of a recording, which begins with the first frame of the first camera in recording.json. If this
    camera was left out, its recorded times are used; if they do not overlap with the frames, the start is unknown.
    """
    time_s, left_out_s = recording.streams[0].time_s, recording.left_out_s
    span = recorded_span(time_s)
    if left_out_s is None:
        return span
    first_s, last_s = left_out_s
    return replace(span, first_s=first_s if first_s <= time_s[-1] and time_s[0] <= last_s else None)


def events_files(folder: Path) -> list[Path]:
    """Return the paths of events.tsv and events.json, if they exist; empty without an events.tsv."""
    path = folder / EVENTS_FILE
    return [file for file in (path, sidecar_of(path)) if is_there(file)] if is_there(path) else []


def sidecar_of(path: Path) -> Path:
    """Return the path of the file with the units of an events file: events.json for events.tsv."""
    return path.with_suffix(".json")


def read_trials(path: Path, span: RecordedSpan) -> Trials:
    """Read the trials of an events file; raises InputError naming the file, the line and the remedy.

    The function refuses missing and repeated columns, texts in place of numbers, and a recording whose start is
    unknown. It refuses trials that have no duration, overlap or lie outside the recording, and columns of numbers
    without a unit in the JSON file beside the events file.
    """
    lines = read_rows(path, delimiter="\t", largest_bytes=LARGEST_EVENTS)
    head = lines[0][1] if lines else []
    _require_head(path, head)
    _require_rows(path, head, lines[1:])
    described = _read_sidecar(sidecar_of(path), head)
    first_s = _known_start(path, span)
    trials = [_trial(path, line, dict(zip(head, row, strict=True)), first_s, span.end_s) for line, row in lines[1:]]
    _require_apart(path, [(line, trial) for (line, _), trial in zip(lines[1:], trials, strict=True)])
    columns, cells = list[TrialColumn](), list[list[float | str | None]]()
    for place, name in enumerate(head):
        if name not in REQUIRED:
            columns.append(_column(path, name, [row[place] for _, row in lines[1:]], described.get(name)))
            cells.append([_cell(path, line, columns[-1], row[place]) for line, row in lines[1:]])
    rows = (replace(trial, number=k + 1, cells=tuple(each[k] for each in cells)) for k, trial in enumerate(trials))
    return Trials(tuple(columns), tuple(rows))


_HEAD_REMEDY: Final = (
    "begin it with the line onset, duration, trial_type, separated by tabs: a spreadsheet saves this as text with tabs"
)


def _require_head(path: Path, head: Sequence[str]) -> None:
    missing = [name for name in REQUIRED if name not in head]
    if missing:
        raise InputError(path, f"line 1 has no column {', '.join(missing)}", _HEAD_REMEDY)
    require_distinct(path, [name.casefold() for name in head])
    if len(head) > MOST_COLUMNS:
        raise InputError(path, f"line 1 has {len(head)} columns", f"keep {MOST_COLUMNS} at most")
    for name in head:
        if not name or not name.isprintable() or len(name) > LONGEST_TEXT:
            raise InputError(path, f"line 1 has a column named '{name[:40]!r}'"[:80], "give each column a short name")
        if name.casefold() in RESERVED:
            raise InputError(path, f"line 1 has a column '{name}', a name that the results use", "rename it")


def _require_rows(path: Path, head: Sequence[str], rows: Sequence[tuple[int, list[str]]]) -> None:
    if not rows:
        raise InputError(path, "holds no trial", "add one line per trial, or remove the file")
    if len(rows) > MOST_TRIALS:
        raise InputError(path, f"holds {len(rows)} trials", f"give {MOST_TRIALS} at most")
    for line, cells in rows:
        if len(cells) != len(head):
            problem = f"line {line} has {len(cells)} cells, not {len(head)}"
            raise InputError(path, problem, f"give every line all cells, {MISSING} where a value is missing")
        long = next((cell for cell in cells if len(cell) > LONGEST_TEXT or not cell.isprintable()), None)
        if long is not None:
            raise InputError(path, f"line {line} has the cell {long[:40]!r}", "write a short text without breaks")


def _known_start(path: Path, span: RecordedSpan) -> float:
    if span.first_s is None:
        problem = (
            "has onsets since the first frame of the first camera in recording.json, but that camera measured nothing, "
            "and its times never overlap with the frames"
        )
        remedy = "list a camera that measured first in recording.json, and count onsets from its first frame"
        raise InputError(path, problem, remedy)
    return span.first_s


def _trial(path: Path, line: int, cells: dict[str, str], first_s: float, end_s: float) -> Trial:
    """Return the trial of a line, with the number 0 and without cells of the user's columns: the caller sets both."""
    onset_s, duration_s = (_number(path, line, name, cells[name]) for name in ("onset", "duration"))
    if onset_s is None or duration_s is None or cells["trial_type"] in ("", MISSING):
        name = next(name for name in REQUIRED if cells[name] in ("", MISSING))
        raise InputError(path, f"line {line} has no {name}", "fill it in, or remove the line")
    if duration_s <= 0:
        what = "a negative duration" if duration_s < 0 else "the duration 0"
        raise InputError(path, f"line {line} has {what}", "write how many seconds the trial lasted")
    recorded_s = end_s - first_s
    if onset_s < 0 or onset_s + duration_s > recorded_s + ROUNDING_S:
        problem = (
            f"line {line} is a trial from {onset_s:g} to {onset_s + duration_s:g} s, outside of the recording "
            f"(0 to {recorded_s:.3f} s)"
        )
        raise InputError(path, problem, "count seconds from the first frame of the first camera")
    return Trial(0, cells["trial_type"], onset_s, duration_s, first_s + onset_s)


def _number(path: Path, line: int, name: str, text: str) -> float | None:
    """Parse a number; None if it is missing."""
    if text in ("", MISSING):
        return None
    try:
        value = plain_number(text)
    except ValueError:
        value = np.inf
    if not abs(value) <= LARGEST:
        remedy = f"write a number with a decimal point, or {MISSING} where there is none"
        raise InputError(path, f"line {line} has the {name} '{text[:40]}', which is not a number", remedy)
    return float(value)


def _require_apart(path: Path, numbered: Sequence[tuple[int, Trial]]) -> None:
    ordered = sorted(numbered, key=lambda each: each[1].onset_s)
    for (line, before), (other, after) in pairwise(ordered):
        if after.onset_s < before.onset_s + before.duration_s - ROUNDING_S:
            problem = (
                f"line {other} begins at {after.onset_s:g} s, before the trial of line {line} has ended at "
                f"{before.onset_s + before.duration_s:g} s"
            )
            raise InputError(path, problem, "correct onset or duration: trials may not overlap")


def _require_unit(unit: str) -> str:
    known = _SPELLINGS.get(unit, unit)
    if known in UNITS:
        return known
    guess = next((f"write '{name}'; " for name in UNITS if name.casefold() == unit.casefold()), "")
    raise Unfit(f"is the unknown unit '{unit[:40]}'", f"{guess}known units are {', '.join(UNITS)}")


class ColumnEntry(Entry, extra="ignore"):
    """The entry of a column in events.json; further keys of BIDS are ignored."""

    units: Annotated[str, AfterValidator(_require_unit)] | None = Field(
        default=None, alias="Units", description="a unit such as mA"
    )
    levels: dict[str, object] | None = Field(default=None, alias="Levels", description="the texts of the column")
    description: str = Field(default="", alias="Description", max_length=2000)


def _read_sidecar(path: Path, head: Sequence[str]) -> dict[str, ColumnEntry]:
    """Read the entries of the user's columns from the events' JSON file; empty without such a file."""
    if not is_there(path):
        return {}
    document = read_json(path, LARGEST_EVENTS)
    own = {name: entry for name, entry in document.items() if name in head and name not in REQUIRED}
    return validate(path, dict[str, ColumnEntry], own)


def _column(path: Path, name: str, texts: Sequence[str], entry: ColumnEntry | None) -> TrialColumn:
    """Return the description of a user's column: a column of numbers if ``entry`` gives a unit, else a column of texts.
    The column ``BLOCK_COLUMN`` is always a column of texts. Raises InputError if all cells of another column are
    numbers and ``entry`` gives neither their unit nor levels (the meaning of each value).
    """
    description = "" if entry is None else entry.description
    known = [text for text in texts if text not in ("", MISSING)]
    if name == BLOCK_COLUMN or (entry is not None and entry.units is None and entry.levels is not None):
        return TrialColumn(name, None, description)
    if entry is not None and entry.units is not None:
        return TrialColumn(name, entry.units, description)
    if known and all(_is_number(text) for text in known):
        remedy = f'write {{"{name}": {{"Units": "mA"}}}} with the right unit there, or "1" for a number without unit'
        raise InputError(path, f"has numbers in the column '{name}' without a unit in {sidecar_of(path).name}", remedy)
    return TrialColumn(name, None, description)


def _is_number(text: str) -> bool:
    try:
        plain_number(text)
    except ValueError:
        return False
    return True


def _cell(path: Path, line: int, column: TrialColumn, text: str) -> float | str | None:
    if column.unit is not None:
        return _number(path, line, column.name, text)
    return None if text in ("", MISSING) else text
