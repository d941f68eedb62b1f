"""Read an events file with the trials of results that exist already; times are given on the clock of the recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from anchorpose.errors import InputError
from anchorpose.recording.events import RecordedSpan, Trials, read_trials, recorded_span, sidecar_of
from anchorpose.recording.regular_file import is_there
from anchorpose.results.parquet import TRACK_AGAIN
from anchorpose.results.run_record import RUN_FILE, hash_files, read_run
from anchorpose.results.tables import JOINTS_FILE, read_joints


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
