"""The order of a batch: its sessions on the workers, then the tables and the page over all of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from anchorpose.batch.cluster import Place
from anchorpose.batch.engine import Job, run_jobs
from anchorpose.batch.page import write_page
from anchorpose.batch.sessions import Session
from anchorpose.batch.table import (
    LOGS_FOLDER,
    RESULTS_FOLDER,
    SessionRow,
    measures_of,
    note_outcome,
    row_of,
    write_tables,
)
from anchorpose.batch.tracking import track_session
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.recording.document import read_json
from anchorpose.results.folder import write_text_whole

BATCH_FILE: Final = "batch.json"
FORMAT: Final = "anchorpose-batch"

Progress = Callable[[int, int], None]


def run_batch(sessions: Sequence[Session], out: Path, place: Place, progress: Progress) -> tuple[SessionRow, ...]:
    """Tracks all sessions that are not done and writes the tables and index.html; returns a row per session.

    One that fails keeps no other from its end. progress is called with sessions finished and in total. Raises
    InputError where ``out`` is not the folder of a batch, AnchorposeError where the scheduler cannot be used.
    """
    open_folder(out, sessions)
    progress(0, len(sessions))
    for done, outcome in enumerate(run_jobs([_job(session, out) for session in sessions], place), 1):
        note_outcome(out, outcome)
        progress(done, len(sessions))
    return summarise(sessions, out)


def run_one(sessions: Sequence[Session], out: Path, index: int) -> SessionRow:
    """Tracks the session with this number, counted from 0, on a worker of its own; for arrays of jobs."""
    if not 0 <= index < len(sessions):
        raise AnchorposeError(f"--index is {index}; there are {len(sessions)} sessions, numbered from 0.")
    open_folder(out, sessions)
    for outcome in run_jobs([_job(sessions[index], out)], Place(workers=1)):
        note_outcome(out, outcome)
    return row_of(out, sessions[index])


def summarise(sessions: Sequence[Session], out: Path) -> tuple[SessionRow, ...]:
    """Writes the tables and index.html from what the folder holds; returns a row per session."""
    open_folder(out, sessions)
    rows = tuple(row_of(out, session) for session in sessions)
    measures = {row.session: measures_of(out, row) for row in rows}
    write_tables(out, rows, ((row, measure) for row in rows for measure in measures[row.session]))
    write_page(out, rows, measures)
    return rows


def _job(session: Session, out: Path) -> Job:
    out = out.resolve()
    call = partial(track_session, session.absolute(), out / RESULTS_FOLDER / session.name)
    return Job(session.name, call, out / LOGS_FOLDER / f"{session.name}.log")


def open_folder(out: Path, sessions: Sequence[Session]) -> None:
    """Makes the folder of a batch, or checks that it is one; raises InputError otherwise."""
    mark = out / BATCH_FILE
    if out.exists() and not out.is_dir():
        raise InputError(out, "is a file", "choose another name for the folder of the batch")
    if mark.is_file() and read_json(mark).get("format") != FORMAT:
        raise InputError(mark, "is not of a batch", "choose another folder")
    if not mark.is_file() and out.is_dir() and any(out.iterdir()):
        raise InputError(out, "exists and is not the folder of a batch", "choose another name; nothing was changed")
    inside = [one for one in sessions if one.place is not None and out.resolve().is_relative_to(one.place)]
    if inside:
        raise InputError(out, f"lies inside the recording {inside[0].recording}", "choose a folder outside of it")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(out, f"cannot be made ({error.strerror})", "choose a place that you may write to") from None
    listed = [{"session": one.name, "recording": str(one.recording), "subject": one.subject} for one in sessions]
    write_text_whole(mark, json.dumps({"format": FORMAT, "version": 1, "sessions": listed}, indent=1) + "\n")
