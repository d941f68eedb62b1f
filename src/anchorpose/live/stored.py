"""Store a live session while it runs, write the session's results, and finish a session that ended early."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from anchorpose.body.skin_points import body_points
from anchorpose.errors import InputError
from anchorpose.live.first_seconds import LiveOptions, Prepared, in_room, known_room, new_room
from anchorpose.live.recorder import RECORDING_FILE, finish_recording
from anchorpose.recording.document import read_document, read_text
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording_file import calibration_file, read_calibration
from anchorpose.recording.regular_file import is_there
from anchorpose.results.folder import write_text_whole
from anchorpose.results.run_record import as_json
from anchorpose.results.unfinished import (
    BEGUN_FILE,
    FIRST_SECONDS,
    JOURNAL,
    LIVE,
    begin_journal,
    clear_beside_journal,
    end_journal,
    is_live_session,
    unfinished_results,
)
from anchorpose.threads import one_thread
from anchorpose.tracker.frame_record import TrackedFrame
from anchorpose.tracker.journal import Blocks, Journal
from anchorpose.tracker.learning_pass import LearntPatient
from anchorpose.tracker.room import Run
from anchorpose.writing import write_results


@dataclass(frozen=True, slots=True, eq=False)
class LivePatient:
    """A person who is or was the patient. number: number in the session, from 1; blocks: the stored tracked frames."""

    number: int
    prepared: Prepared
    blocks: Blocks[TrackedFrame]

    @property
    def run(self) -> Run:
        """Return the room and the settings with which the patient is followed."""
        return self.prepared.run

    @property
    def first_frame(self) -> int | None:
        """Return the number of the first stored frame, None without frames."""
        return next((one.record.joints.frame for one in self.blocks.read()), None)


def write_patients(results: Path, patients: Sequence[LivePatient], recorded: Path | None, notes: Sequence[str]) -> None:
    """Write the last patient's results into an existing folder, and each earlier patient's results into a subfolder.

    recorded: a recording of the session, from which pictures are made. Pictures are made from the first seconds if
    ``recorded`` is None, or if it lacks a usable image of a camera that was tracked.
    notes: sentences on the session, for every ``run.json``.
    """
    *earlier, last = patients
    changes = list[str]()
    for one, following in zip(earlier, patients[1:], strict=True):
        folder, frame = f"earlier-patient-{one.number}", following.first_frame
        (results / folder).mkdir()
        _write(results / folder, one, recorded, [f"from frame {frame} on, another person was the patient", *notes])
        changes.append(f"until frame {frame}, another person was the patient: the results are in {folder}")
    if earlier:
        changes.append("the present patient was chosen on the page; nothing was stated about this person")
    _write(results, last, recorded, [*changes, *notes])


def _write(results: Path, patient: LivePatient, recorded: Path | None, notes: Sequence[str]) -> None:
    run, learnt, inputs = patient.run, patient.prepared.learnt, patient.prepared.inputs
    room = run.room
    if recorded is not None:
        try:
            room = replace(room, recording=in_room(recorded, room))
        except InputError as error:
            notes = (*notes, f"pictures are only made from the first seconds: {str(error).removesuffix('.')}")
    run = replace(run, room=replace(room, notes=(*room.notes, *notes)))
    write_results(results, patient.blocks.read(), run, learnt, inputs)


SESSION_FILE: Final = "session.json"
LEARNT: Final = "learnt"


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredPatient:
    """A patient as stored in ``session.json``. first_seconds: name of the folder with the recording of their first
    seconds; place_xz_m: x and z at which this person stood when chosen as the patient, None for the first patient.
    """

    first_seconds: str
    place_xz_m: tuple[float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredSession:
    """The document ``session.json``. ended: why the session ended early. The default reason applies if the program was
    killed and could not write a reason.
    """

    options: LiveOptions
    patients: tuple[StoredPatient, ...] = ()
    ended: str = "the program was killed, or the computer stopped"


class SessionStore:
    """The stored data of a new session, in its future results folder; ``finish_session`` reads them if the session ends
    early.
    """

    def __init__(self, results: Path, options: LiveOptions) -> None:
        self._results = results
        self._journal = _journal(begin_journal(results, f"{LIVE} {time.time_ns()}", {}))
        self.first_seconds = self._journal.folder / FIRST_SECONDS
        self.first_seconds.mkdir()
        self._session = StoredSession(options=_with_own_files(options, self.first_seconds))

    def add(self, prepared: Prepared) -> LivePatient:
        """Store a new patient, and return this patient with an empty store of frames."""
        place_xz_m, folder = prepared.inputs.config.patient_xz_m, prepared.inputs.recording.folder
        number = len(self._session.patients) + 1
        journal = self._journal.inside(f"patient-{number}")
        with instead_of_resuming(MAKE_ROOM):
            journal.write(LEARNT, prepared.learnt)
        stored = StoredPatient(first_seconds=folder.name, place_xz_m=place_xz_m)
        self._write(replace(self._session, patients=(*self._session.patients, stored)))
        clear_beside_journal(self._results)
        return LivePatient(number, prepared, Blocks(journal, TrackedFrame))

    def end_early(self, why: str) -> None:
        """Store why the session ended early, if a patient is stored and the disk has space."""
        if self._session.patients:
            with suppress(OSError):
                self._write(replace(self._session, ended=why))

    def _write(self, session: StoredSession) -> None:
        self._session = session
        write_text_whole(self._journal.folder / SESSION_FILE, json.dumps(as_json(session)))


MAKE_ROOM: Final = "make room and give the same command with --finish"
BEGIN_AGAIN: Final = "begin again with 'anchorpose live' and --overwrite"


@contextmanager
def instead_of_resuming(remedy: str, folder: Path | None = None) -> Iterator[None]:
    """Replace the advice in an InputError by ``remedy``. The usual advice is to resume the run or to track again, and a
    live session permits neither. folder: only advice about files in this folder is replaced; None: all advice.
    """
    try:
        yield
    except InputError as error:
        if folder is not None and not error.path.is_relative_to(folder):
            raise
        raise InputError(error.path, error.problem, remedy) from error


def read_session(results: Path) -> StoredSession:
    """Read the session of an unfinished results folder; raises InputError if the folder has no session yet."""
    path = results / JOURNAL / SESSION_FILE
    if not is_there(path):
        if any(path.parent.glob("patient-*/*.frames")):
            raise InputError(path, "is missing, and the stored frames are useless without it", "put it back")
        raise InputError(results, "was cut off before a patient was found", "begin again with 'anchorpose live'")
    return read_document(path, StoredSession)


def read_patients(results: Path, session: StoredSession) -> Iterator[LivePatient]:
    """Yield the patients of a stored session. Each room is computed again from the patient's first seconds; bodies and
    frames are read as stored.
    """
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
        prepared = Prepared(inputs, run.with_learnt(learnt.belief), learnt)
        yield LivePatient(number, prepared, Blocks(inside, TrackedFrame))


def _journal(folder: Path) -> Journal:
    return Journal(folder, {"points": body_points(), "asset": body_points().asset})


def _with_own_files(options: LiveOptions, folder: Path) -> LiveOptions:
    """Copy the calibration file to a subfolder of ``folder``, and return the options with the path of this copy,
    relative to ``folder``, and with absolute paths of other files and folders.

    Raises InputError if the calibration file cannot be used.
    """
    if options.record is not None:
        options = replace(options, record=options.record.resolve())
    if options.config.motions is not None:
        options = replace(options, config=replace(options.config, motions=str(Path(options.config.motions).resolve())))
    if options.calibration is None:
        return options
    read_calibration(options.calibration)
    file = calibration_file(options.calibration)
    (folder / "calibration").mkdir()
    write_text_whole(folder / "calibration" / file.name, read_text(file))
    return replace(options, calibration=Path("calibration") / file.name)


def finish_session(results: Path, overwrite: bool) -> None:
    """Make the results folder of an unfinished session from all stored frames.

    Nothing is tracked again; the room is computed again from the first seconds. Raises InputError if the session does
    not exist or has no frames.
    """
    if not is_live_session(results):
        remedy = "give the name that 'anchorpose live' was given with -o"
        raise InputError(results, "has no live session that was cut off", remedy)
    with unfinished_results(results, None, overwrite, resume=True) as folder, instead_of_resuming(BEGIN_AGAIN, folder):
        session = read_session(folder)
        note = f"the live session ended early ({session.ended}): these results are of the frames that were stored"
        with one_thread():
            found = [one for one in read_patients(folder, session) if one.first_frame is not None]
            if not found:
                raise InputError(folder, "holds no tracked frame", BEGIN_AGAIN)
            clear_beside_journal(folder)
            write_patients(folder, found, _recorded(session.options.record), [note])
        end_journal(folder)


def _recorded(folder: Path | None) -> Path | None:
    """Return the folder of the session's recording, completed if necessary; None if the session was not recorded or the
    recording cannot be completed.
    """
    if folder is None:
        return None
    with suppress(InputError, OSError):
        finish_recording(folder)
    return folder if (folder / RECORDING_FILE).is_file() else None
