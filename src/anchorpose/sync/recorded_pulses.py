"""Read the pulses that both devices recorded, on the recording's clock, from a table of events or pulses."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.document import read_rows, read_text
from anchorpose.recording.events import MISSING
from anchorpose.recording.regular_file import LARGEST_TABLE
from anchorpose.results.parquet import TRACK_AGAIN
from anchorpose.results.run_record import RUN_FILE, read_run
from anchorpose.results.tables import JointTable
from anchorpose.sync.csv_file import TIME_COLUMNS, read_csv
from anchorpose.sync.pulses import Pulses, pulses_of_signal

EVENTS_REMEDY: Final = "give an events.tsv, whose first line begins with onset, duration, trial_type, or a .csv"


def recorded_pulses(path: Path, results: Path, joints: JointTable, column: str, kind: str | None) -> tuple[Pulses, ...]:
    """Return the possible interpretations (readings) of the recorded pulses as starts and ends, on the clock of the
    first camera. A signal has two readings (``pulses_of_signal``), since its rising edges may be the starts or the ends
    of pulses; other files have a single reading.

    path: an events.tsv, whose onsets count from the recording's first frame; or a .csv on the recording's clock, either
    with the signal ``column``, or with a single column of times, one per pulse. kind: the trial_type of the rows that
    are pulses, None for all rows. Raises InputError if the file cannot be used.
    """
    if path.suffix.lower() == ".tsv":
        start_s, end_s = _events(path, kind)
        first_s = first_frame_s(results, joints)
        return (Pulses(np.unique(start_s + first_s), np.unique(end_s + first_s)),)
    if kind is not None:
        raise InputError(path, "is not an events.tsv", "leave out --pulse-type, or give an events.tsv")
    if path.suffix.lower() != ".csv":
        raise InputError(path, f"ends in '{path.suffix}'", EVENTS_REMEDY)
    text = read_text(path, LARGEST_TABLE)
    if text.partition("\n")[0].strip() in TIME_COLUMNS:
        return (Pulses(np.unique([_number(path, cell) for cell in text.split()[1:]])),)
    time_s, values = read_csv(path).take((column,))
    return pulses_of_signal(time_s, values[:, 0])


def _events(path: Path, kind: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the starts (p,) and the known ends (q,) in an events.tsv, of the rows with one trial_type or of all
    rows. The file is read by the same rules as a recording's own events.tsv, so cells may have quotes around them.
    """
    lines = [cells for _, cells in read_rows(path, delimiter="\t")]
    head = lines[0] if lines else []
    if not {"onset", "trial_type"} <= set(head):
        raise InputError(path, "has no columns onset and trial_type", EVENTS_REMEDY)
    if any(len(line) != len(head) for line in lines):
        raise InputError(path, f"has lines without {len(head)} cells", "correct them")
    onset, name = head.index("onset"), head.index("trial_type")
    chosen = [line for line in lines[1:] if kind is None or line[name] == kind]
    if not chosen:
        raise InputError(path, f"has no row of the trial_type '{kind}'" if kind else "has no row", EVENTS_REMEDY)
    start_s = np.array([_number(path, line[onset]) for line in chosen])
    column = head.index("duration") if "duration" in head else None
    cells = [MISSING if column is None else line[column] or MISSING for line in chosen]
    lasts_s = np.array([0.0 if cell == MISSING else _number(path, cell) for cell in cells])
    return start_s, (start_s + lasts_s)[lasts_s > 0]  # a duration of 0 marks an event of unknown duration


def _number(path: Path, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(path, f"has the time '{text[:40]}'", "write seconds with a decimal point")
    return value


def first_frame_s(results: Path, joints: JointTable) -> float:
    """Return the recording's start time on the clock of its first camera; raises InputError if this time is unknown."""
    run: dict[str, Any] = read_run(results / RUN_FILE)
    recorded = run.get("recorded")
    if recorded and recorded["first_s"] is not None:
        return float(recorded["first_s"])
    if recorded:
        problem = "does not know when the recording began: its first camera measured nothing, and has other times"
        raise InputError(results / RUN_FILE, problem, "compare the clocks by movement")
    if (run.get("config") or {}).get("start"):
        problem = "does not state when the recording began, and its beginning was not tracked"
        raise InputError(results / RUN_FILE, problem, TRACK_AGAIN)
    return float(joints.time_s[0])
