"""What is stored of a live session while it runs, so that one that ended early can be finished (``live.finish``)."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from anchorpose.body.skin_points import body_points
from anchorpose.errors import InputError
from anchorpose.live.first_seconds import LiveOptions, Prepared, known_room, new_room
from anchorpose.live.patients import LivePatient
from anchorpose.recording.document import read_document, read_text
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording_file import CALIBRATION_FILE, read_calibration
from anchorpose.recording.regular_file import is_there
from anchorpose.results.folder import (
    BEGUN_FILE,
    FIRST_SECONDS,
    JOURNAL,
    LIVE,
    begin_journal,
    clear_beside_journal,
    write_text_whole,
)
from anchorpose.results.run_record import as_json
from anchorpose.tracker.frame_record import TrackedFrame
from anchorpose.tracker.journal import Blocks, Journal
from anchorpose.tracker.learning_pass import LearntPatient
from anchorpose.tracker.room import Run

SESSION_FILE: Final = "session.json"
LEARNT: Final = "learnt"


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredPatient:
    """first_seconds: name of the folder that they were recorded in; place_xz_m: where the patient was said to stand."""

    first_seconds: str
    place_xz_m: tuple[float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredSession:
    """The document ``session.json``. ended: why the session ended early, where that could still be written."""

    options: LiveOptions
    patients: tuple[StoredPatient, ...] = ()
    ended: str = "the program was killed, or the computer stopped"


class SessionStore:
    """The journal of a session that begins, in a results folder that is being made."""

    def __init__(self, results: Path, options: LiveOptions) -> None:
        self._results = results
        self._journal = _journal(begin_journal(results, f"{LIVE} {time.time_ns()}", {}))
        self.first_seconds = self._journal.folder / FIRST_SECONDS
        self.first_seconds.mkdir()
        self._session = StoredSession(options=_with_own_files(options, self.first_seconds))

    def add(self, prepared: Prepared) -> LivePatient:
        """One more patient, with an empty store of frames."""
        place_xz_m, folder = prepared.inputs.config.patient_xz_m, prepared.inputs.recording.folder
        number = len(self._session.patients) + 1
        journal = self._journal.inside(f"patient-{number}")
        with on_this_disk():
            journal.write(LEARNT, prepared.learnt)
        stored = StoredPatient(first_seconds=folder.name, place_xz_m=place_xz_m)
        self._write(replace(self._session, patients=(*self._session.patients, stored)))
        clear_beside_journal(self._results)
        return LivePatient(number, prepared, Blocks(journal, TrackedFrame))

    def end_early(self, why: str) -> None:
        """Notes why, if a patient is stored and the disk has room for it."""
        if self._session.patients:
            with suppress(OSError):
                self._write(replace(self._session, ended=why))

    def _write(self, session: StoredSession) -> None:
        self._session = session
        write_text_whole(self._journal.folder / SESSION_FILE, json.dumps(as_json(session)))


@contextmanager
def on_this_disk() -> Iterator[None]:
    """Gives an error of the journal a remedy that holds for a live session, which cannot be resumed."""
    try:
        yield
    except InputError as error:
        raise InputError(error.path, error.problem, "make room and give the same command with --finish") from None


def read_session(results: Path) -> StoredSession:
    """The session that an unfinished results folder holds; raises InputError where none came so far."""
    path = results / JOURNAL / SESSION_FILE
    if not is_there(path):
        if any(path.parent.glob("patient-*/*.frames")):
            raise InputError(path, "is missing, without which the frames that are stored are of no use", "put it back")
        raise InputError(results, "was cut off before a patient was found", "begin again with 'anchorpose live'")
    return read_document(path, StoredSession)


def read_patients(results: Path, session: StoredSession) -> Iterator[LivePatient]:
    """The patients of a stored session: rooms found again in their first seconds, bodies and frames as stored."""
    journal = _journal(results / JOURNAL)
    journal.require_whole((BEGUN_FILE, SESSION_FILE, FIRST_SECONDS))
    calibration = session.options.calibration
    first_seconds, room = journal.folder / FIRST_SECONDS, None
    options = replace(session.options, calibration=None if calibration is None else first_seconds / calibration)
    for number, stored in enumerate(session.patients, start=1):
        inside = journal.inside(f"patient-{number}")
        recording = open_recording(first_seconds / stored.first_seconds)
        if room is None or stored.place_xz_m is None:
            inputs, room = new_room(recording, options)
        else:
            inputs, room = known_room(recording, options, room, stored.place_xz_m)
        run = Run(room, options.live(inputs.config))
        try:
            learnt = inside.read(LEARNT, LearntPatient)
        except KeyError:
            raise InputError(inside.folder / LEARNT, "is missing", "put it back") from None
        yield LivePatient(number, Prepared(inputs, run, learnt), Blocks(inside, TrackedFrame))


def _journal(folder: Path) -> Journal:
    return Journal(folder, {"points": body_points(), "asset": body_points().asset})


def _with_own_files(options: LiveOptions, folder: Path) -> LiveOptions:
    """The options with a copy of the calibration, named from ``folder``, and other paths from the root.

    Raises InputError where the calibration cannot be used.
    """
    if options.record is not None:
        options = replace(options, record=options.record.resolve())
    if options.config.motions is not None:
        options = replace(options, config=replace(options.config, motions=str(Path(options.config.motions).resolve())))
    if options.calibration is None:
        return options
    read_calibration(options.calibration)
    file = options.calibration / CALIBRATION_FILE if options.calibration.is_dir() else options.calibration
    (folder / "calibration").mkdir()
    write_text_whole(folder / "calibration" / file.name, read_text(file))
    return replace(options, calibration=Path("calibration") / file.name)
