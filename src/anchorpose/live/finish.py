"""Results of a live session that ended early, for instance because the disk was full or the program was killed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.live.patients import write_patients
from anchorpose.live.recorder import RECORDING_FILE, finish_recording
from anchorpose.live.stored import read_patients, read_session
from anchorpose.results.folder import clear_beside_journal, end_journal, is_live_session, unfinished_results
from anchorpose.threads import one_thread

BEGIN_AGAIN: Final = "begin again with 'anchorpose live' and --overwrite"


def finish_session(results: Path, overwrite: bool) -> None:
    """Make the results folder of an unfinished session of all frames that are stored.

    Nothing is tracked again; the room is found again in the first seconds. Raises InputError where there is no such
    session, or no frame in it.
    """
    if not is_live_session(results):
        remedy = "give the name that 'anchorpose live' was given with -o"
        raise InputError(results, "has no live session that was cut off", remedy)
    with unfinished_results(results, None, overwrite, resume=True) as folder, _remedy_of_live(folder):
        session = read_session(folder)
        note = f"the live session ended early ({session.ended}): these results are of the frames that were stored"
        with one_thread():
            found = [one for one in read_patients(folder, session) if one.first_frame is not None]
            if not found:
                raise InputError(folder, "holds no tracked frame", BEGIN_AGAIN)
            clear_beside_journal(folder)
            write_patients(folder, found, _recorded(session.options.record), [note])
        end_journal(folder)


@contextmanager
def _remedy_of_live(folder: Path) -> Iterator[None]:
    """Gives a refusal of what is stored a remedy that holds for a live session, which cannot be tracked again."""
    try:
        yield
    except InputError as error:
        if not error.path.is_relative_to(folder):
            raise
        raise InputError(error.path, error.problem, BEGIN_AGAIN) from error


def _recorded(folder: Path | None) -> Path | None:
    """The recording of the session, whole; None where there is none, or no more."""
    if folder is None:
        return None
    with suppress(InputError, OSError):
        finish_recording(folder)
    return folder if (folder / RECORDING_FILE).is_file() else None
