"""Store the trials of a results folder, and each trial's contacts and episodes, in two tables beside the measures; also
read the trials from an events file that is given for existing results.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from anchorpose.errors import InputError
from anchorpose.recording.document import parse_json
from anchorpose.recording.events import (
    MOST_TRIALS,
    UNITS,
    RecordedSpan,
    Trial,
    TrialColumn,
    Trials,
    read_trials,
    recorded_span,
    sidecar_of,
)
from anchorpose.recording.recording_file import FARTHEST_TIME_S
from anchorpose.recording.regular_file import is_there
from anchorpose.results.corrections import LATEST_FRAME
from anchorpose.results.parquet import (
    TRACK_AGAIN,
    RecordTable,
    open_parquet,
    read_any_parquet,
    require_columns,
    schema_of,
)
from anchorpose.results.run_record import RUN_FILE, hash_files, read_run
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.settings import LARGEST, Unfit

TRIALS_FILE: Final = "trials.parquet"
COLUMNS_KEY: Final = "trial_columns"
"""Key in the metadata of trials.parquet: name, unit and description of each column that the user added, as JSON."""

TRIALS_REMEDY: Final = "run 'anchorpose measure' on its folder again, with --events"

FIXED: Final = pa.schema(
    [
        pa.field("trial", pa.int32(), nullable=False),
        pa.field("condition", pa.string(), nullable=False),
        *(pa.field(name, pa.float64(), nullable=False) for name in ("onset_s", "duration_s", "start_s", "end_s")),
    ]
)
"""The columns of the table that come before the user's columns."""


def write_trials(path: Path, trials: Trials) -> None:
    """Write trials.parquet: one row per trial in the order of the events file; the user's columns are stored as numbers
    or texts.
    """
    own = [pa.field(column.name, _type_of(column)) for column in trials.columns]
    described = [{"name": c.name, "unit": c.unit, "description": c.description} for c in trials.columns]
    schema = pa.schema([*FIXED, *own], metadata={COLUMNS_KEY: json.dumps(described, sort_keys=True)})
    rows = trials.rows
    fixed = ([getattr(row, name if name != "trial" else "number") for row in rows] for name in FIXED.names)
    cells = ([row.cells[place] for row in rows] for place in range(len(trials.columns)))
    arrays = [pa.array(values, field.type) for values, field in zip([*fixed, *cells], schema, strict=True)]
    with open_parquet(path, schema) as writer:
        writer.write_table(pa.Table.from_arrays(arrays, schema=schema))


def read_trial_table(path: Path) -> Trials:
    """Read the trials of a results folder; raises InputError if the file is not such a table."""
    table = read_any_parquet(path)
    columns = _columns(path, table.schema.metadata or {})
    own = [pa.field(column.name, _type_of(column)) for column in columns]
    require_columns(path, table.schema, pa.schema([*FIXED, *own]))
    rows = table.to_pylist()
    for number, row in enumerate(rows, 1):
        values = [row[name] for name in ("onset_s", "duration_s", "start_s")]
        known = row["condition"] and row["trial"] == number and all(v is not None and abs(v) <= LARGEST for v in values)
        if not known or row["duration_s"] <= 0:
            raise InputError(path, f"has an impossible trial in row {number}", TRIALS_REMEDY)
    if not rows or len(rows) > MOST_TRIALS:
        raise InputError(path, f"holds {len(rows)} trials", TRIALS_REMEDY)
    cells = [tuple(row[column.name] for column in columns) for row in rows]
    trials = [
        Trial(row["trial"], row["condition"], row["onset_s"], row["duration_s"], row["start_s"], own)
        for row, own in zip(rows, cells, strict=True)
    ]
    return Trials(columns, tuple(trials))


def _type_of(column: TrialColumn) -> pa.DataType:
    return pa.string() if column.unit is None else pa.float64()


def _columns(path: Path, metadata: dict[bytes, bytes]) -> tuple[TrialColumn, ...]:
    try:
        found = tuple(TrialColumn(**each) for each in parse_json(metadata.get(COLUMNS_KEY.encode(), b"")))
    except (Unfit, TypeError):
        raise InputError(path, "does not describe its columns", TRIALS_REMEDY) from None
    texts = [text for each in found for text in (each.name, each.description)]
    if not all(isinstance(text, str) for text in texts) or any(c.unit not in (None, *UNITS) for c in found):
        raise InputError(path, "does not describe its columns by texts and units", TRIALS_REMEDY)
    return found


def read_trials_of(results: Path, events: Path) -> tuple[Trials, dict[str, str]]:
    """Read the trials of an events file, and, by file name, the SHA-256 of this file and of the file that states the
    units of its columns.

    Raises InputError if a file cannot be used, or if it is unknown when the recording began.
    """
    trials = read_trials(events, _span_of(results))
    files = [file for file in (events, sidecar_of(events)) if is_there(file)]
    return trials, dict(hash_files(files, events.parent))


def _span_of(results: Path) -> RecordedSpan:
    """Return the start and end of the recording, from run.json or, if all frames were tracked, from joints.parquet."""
    run: dict[str, Any] = read_run(results / RUN_FILE)
    if run.get("recorded"):
        return RecordedSpan(**run["recorded"])
    config = run.get("config") or {}
    if config.get("start") or config.get("stop") is not None:
        problem = "does not state when the recording began, and not all of it was tracked"
        raise InputError(results / RUN_FILE, problem, f"{TRACK_AGAIN}, with --events")
    return recorded_span(read_joints(results / JOINTS_FILE).time_s)


def trial_rows(trial: Trial, time_s: np.ndarray) -> slice:
    """Return the rows of a trial among frames at time_s (n,), increasing; a frame exactly at the trial's end belongs to
    the next trial.

    Half a millisecond is allowed for the rounding of written times.
    """
    ends = np.searchsorted(time_s, np.array([trial.start_s, trial.end_s]) - ROUNDING_S)
    return slice(int(ends[0]), int(ends[1]))


ROUNDING_S: Final = 0.0005  # s, maximum error of a time that was rounded to milliseconds

EPISODE, CONTACT = "episodes", "contacts"


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialInterval:
    """The part of an episode or a contact that lies in a trial.

    table: ``episodes`` or ``contacts``; row: its row in this table, from 0. kind: the kind of the episode, or the
    touched part of the body; person: who touches, None for an episode. first_frame, last_frame and start_s, end_s:
    first and last frame of the part in the trial (both included), and their times. seconds: the time that the part's
    frames represent.
    """

    trial: int
    condition: str
    table: str
    row: int
    kind: str
    person: str | None
    first_frame: int
    last_frame: int
    start_s: float
    end_s: float
    seconds: float


INTERVALS: Final = RecordTable(
    file="trial_intervals.parquet",
    record=TrialInterval,
    schema=schema_of(TrialInterval),
    known={"table": (EPISODE, CONTACT)},
    limits={
        "trial": (1, MOST_TRIALS),
        **dict.fromkeys(("row", "first_frame", "last_frame"), (0, LATEST_FRAME)),
        **dict.fromkeys(("start_s", "end_s"), (-FARTHEST_TIME_S, FARTHEST_TIME_S)),
        "seconds": (0, LARGEST),
    },
    remedy=TRIALS_REMEDY,
)
INTERVALS_FILE, read_intervals, write_intervals = INTERVALS.file, INTERVALS.read, INTERVALS.write
