"""Track the sessions of a batch, each in a separate process, then write the tables and the page of all sessions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

from anchorpose.batch.cluster import Job, Place, run_jobs
from anchorpose.batch.sessions import Session, open_folder
from anchorpose.batch.summary import (
    LOGS_FOLDER,
    RESULTS_FOLDER,
    SessionRow,
    done_identity,
    identity_of,
    note_outcome,
    require_places,
    row_of,
    write_page,
    write_tables,
)
from anchorpose.errors import AnchorposeError
from anchorpose.remote import local_copy
from anchorpose.results.run_record import RUN_FILE
from anchorpose.results.unfinished import begun_identity, wait_until_free

Progress = Callable[[int, int], None]


def run_batch(sessions: Sequence[Session], out: Path, place: Place, progress: Progress) -> tuple[SessionRow, ...]:
    """Track all sessions that are not done and write the tables and index.html; return a row per session.

    A failure does not affect other sessions. progress is called with the numbers of finished sessions and of all
    sessions. Raises InputError if ``out`` is not the folder of a batch, AnchorposeError if the scheduler cannot be
    used.
    """
    sessions, outcomes = _opened(out, sessions), dict[str, str | None]()
    progress(0, len(sessions))
    for done, outcome in enumerate(run_jobs([_job(session, out) for session in sessions], place), 1):
        outcomes[outcome.name] = outcome.why
        with suppress(OSError):  # tables, written later, state the failure too
            note_outcome(out, outcome)
        progress(done, len(sessions))
    return _summarise(sessions, out, outcomes)


def run_one(sessions: Sequence[Session], out: Path, index: int) -> SessionRow:
    """Track only session number ``index``, counted from 0; return its row. Each job of a scheduler's job array, such as
    SLURM's, can track one session in this way.
    """
    if not 0 <= index < len(sessions):
        raise AnchorposeError(f"--index is {index}; there are {len(sessions)} sessions, numbered from 0.")
    session = _opened(out, sessions)[index]
    for outcome in run_jobs([_job(session, out)], Place(workers=1)):
        note_outcome(out, outcome)
    return row_of(out, session)[0]


def summarise(sessions: Sequence[Session], out: Path) -> tuple[SessionRow, ...]:
    """Write the tables and index.html from the files in the batch's folder; track nothing. Return a row per session."""
    return _summarise(_opened(out, sessions), out, {})


def _opened(out: Path, sessions: Sequence[Session]) -> tuple[Session, ...]:
    named = open_folder(out, sessions)
    require_places(out, named)
    return named


def _summarise(sessions: Sequence[Session], out: Path, outcomes: Mapping[str, str | None]) -> tuple[SessionRow, ...]:
    found = [row_of(out, session, outcomes) for session in sessions]
    rows, measures = tuple(row for row, _ in found), {row.session: own for row, own in found}
    write_tables(out, rows, ((row, measure) for row in rows for measure in measures[row.session]))
    write_page(out, rows, measures)
    return rows


def _job(session: Session, out: Path) -> Job:
    out = out.resolve()
    call = partial(track_session, session.absolute(), out / RESULTS_FOLDER / session.name)
    return Job(session.name, call, out / LOGS_FOLDER / f"{session.name}.log")


ENDING_S: Final = 30.0  # s, maximum wait for the child process of a killed worker to end


def track_session(session: Session, results: Path) -> bool:
    """Track a session; the folder ``results`` appears when tracking is complete. Return False if the results were
    complete before.

    A session is done if its ``run.json`` has the identity, a hash of the present inputs, settings, code and libraries.
    Results of another identity are replaced; an unfinished run is resumed if it has the same identity, else begun
    again. Raises the same errors as ``anchorpose track``.
    """
    from anchorpose.api.recording_input import as_recording
    from anchorpose.cli.console import OnConsole
    from anchorpose.cli.track_verbs import track_locally

    results.parent.mkdir(parents=True, exist_ok=True)
    wait_until_free(results, ENDING_S)
    with local_copy(session.recording) as source:
        recording, begun = as_recording(source, OnConsole()), begun_identity(results)
        resume = False
        if begun is not None or (results / RUN_FILE).is_file():
            identity = identity_of(session, recording)
            if done_identity(results) == identity:
                return False
            resume = begun == identity
        track_locally(recording, results, replace(session.options, overwrite=True, resume=resume), "the same command")
    return True
