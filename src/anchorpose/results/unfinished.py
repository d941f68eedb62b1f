"""A results folder that is being made: a run that was stopped or killed goes on in it.

It is recognised by a file in it, not by its name: a folder without that file, or with a link in it, is never touched.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from filelock import FileLock, Timeout

from anchorpose.errors import AnchorposeError, InputError
from anchorpose.recording.document import LARGEST_WITH_HASHES, read_json, read_text
from anchorpose.results.folder import RESULTS, check_results_path, make_folder, naming_place, publish, write_text_whole

JOURNAL: Final = "journal"
"""The folder in an unfinished results folder that holds what the run has done so far."""

LIVE: Final = "live session"
"""How the identity of a live session begins: it cannot be tracked again, only finished."""

FIRST_SECONDS: Final = "first-seconds"
"""The folder in a journal that holds the first seconds of a live session; alone, they are not worth keeping."""

BEGUN_FILE: Final = "begun.json"
LOCK_FILE: Final = ".lock"
MARK_FILE: Final = ".anchorpose"
MARK: Final = json.dumps({"format": "anchorpose-unfinished", "version": 1})

RESUME: Final = "the same command with --resume"


@contextmanager
def unfinished_results(
    path: Path, recording: Path | None, overwrite: bool = False, resume: bool = False, go_on: str = RESUME
) -> Iterator[Path]:
    """The folder ``.NAME.unfinished`` beside ``path``, which becomes ``path`` when the block ends without an error.

    Otherwise it stays, if the run has stored anything in it, and ``resume`` goes on with it. It is locked: a second
    run into ``path`` at the same time is refused. recording: None where the images come from cameras. go_on: what the
    user does to go on with a run that was stopped. Raises InputError before anything is written where results may not
    go to ``path``, another folder has that name, or an unfinished run is there and neither ``resume`` nor ``overwrite``
    is given.
    """
    check_results_path(path, recording, overwrite)
    work = _work_of(path)
    _claim(work, path)
    with _locked(work, path):
        stored = _has_stored(work)
        if stored and not resume and not overwrite:
            remedy = f"{_going_on(path, go_on)}; to begin again, give --overwrite"
            raise InputError(path, f"has an unfinished run, in {work}", remedy)
        _clear(work, keep=(LOCK_FILE, MARK_FILE, JOURNAL) if stored and resume else (LOCK_FILE, MARK_FILE))
        try:
            with naming_place(path):
                yield work
                for name in (LOCK_FILE, MARK_FILE):
                    (work / name).unlink()
                publish(work, path, RESULTS.own if overwrite else ())
        except BaseException as error:
            _leave(work, error, _going_on(path, go_on))
            raise


def begun_identity(path: Path) -> str | None:
    """The identity of the unfinished run into ``path``; None where there is none, or it cannot be read."""
    work = _work_of(path)
    begun = work / JOURNAL / BEGUN_FILE
    try:
        identity = read_json(begun, LARGEST_WITH_HASHES).get("identity") if _is_own(work) and begun.is_file() else None
    except InputError:
        return None
    return identity if isinstance(identity, str) else None


def wait_until_free(path: Path, timeout_s: float) -> None:
    """Waits while another run writes into ``path``, at most ``timeout_s``; a killed one takes a moment to end."""
    work = _work_of(path)
    if _is_own(work):
        with suppress(Timeout), FileLock(work / LOCK_FILE, timeout=timeout_s):
            pass


def _work_of(path: Path) -> Path:
    target = path.resolve()
    return target.parent / f".{target.name}.unfinished"


def _claim(work: Path, path: Path) -> None:
    """Makes and marks the folder where it is absent or empty; raises InputError where it is not this program's."""
    if not os.path.lexists(work):
        make_folder(work, path)
    if work.is_dir() and not work.is_symlink() and not any(work.iterdir()):
        with naming_place(path):
            (work / MARK_FILE).write_text(MARK, encoding="utf-8")
    if not _is_own(work):
        raise InputError(work, "is in the way, and not of an unfinished run", "rename it")


def _is_own(work: Path) -> bool:
    """Whether this program has made the folder, and nothing in it leads out of it."""
    try:
        marked = not work.is_symlink() and read_text(work / MARK_FILE) == MARK
    except InputError:
        return False
    return marked and not any(entry.is_symlink() for entry in work.rglob("*"))


@contextmanager
def _locked(work: Path, path: Path) -> Iterator[None]:
    lock = FileLock(work / LOCK_FILE)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise InputError(path, "is being made by another run", "wait for it, or choose another name") from None
    try:
        yield
    finally:
        lock.release()


def _has_stored(work: Path) -> bool:
    """Whether the run has come so far that going on saves work."""
    journal = work / JOURNAL
    files = [file for file in journal.rglob("*") if file.is_file()]
    others = [file for file in files if file.name != BEGUN_FILE and FIRST_SECONDS not in file.parts]
    return (journal / BEGUN_FILE).is_file() and bool(others)


def is_live_session(path: Path) -> bool:
    """Return whether the unfinished run into ``path`` is a live session."""
    return (begun_identity(path) or "").startswith(LIVE)


def _going_on(path: Path, go_on: str) -> str:
    """Return how the run that is stored is continued, as a clause."""
    return f"'anchorpose live --finish -o {path}' finishes it" if is_live_session(path) else f"{go_on} goes on"


def _clear(work: Path, keep: Sequence[str]) -> None:
    for entry in [entry for entry in work.iterdir() if entry.name not in keep]:
        shutil.rmtree(entry) if entry.is_dir() else entry.unlink()


def _leave(work: Path, error: BaseException, going_on: str) -> None:
    """Removes what is of no use any more, else notes how to go on; a refusal has its own remedy."""
    if _has_stored(work):
        if not isinstance(error, AnchorposeError):
            error.add_note(f"What was done is kept: {going_on}.")
    elif work.is_dir():
        shutil.rmtree(work, ignore_errors=True)


def begin_journal(results: Path, identity: str, inputs: dict[str, str]) -> Path:
    """The journal's folder in a results folder that is being made, new or of a run with the same identity.

    identity: of inputs, settings and code; inputs: the hash of each file by its path in the recording. Raises
    InputError where the run that was begun had others.
    """
    journal = results / JOURNAL
    path = journal / BEGUN_FILE
    if path.is_file():
        begin_again = "to begin again, give --overwrite instead of --resume"
        try:
            begun = read_json(path, LARGEST_WITH_HASHES)
        except InputError:
            raise InputError(path, "is damaged", begin_again) from None
        if str(begun.get("identity")).startswith(LIVE):
            raise InputError(results, "is a live session", "finish it with 'anchorpose live --finish'")
        if begun.get("identity") != identity:
            raise InputError(results, _what_changed(begun.get("inputs_sha256"), inputs), begin_again)
        return journal
    journal.mkdir()
    write_text_whole(path, json.dumps({"identity": identity, "inputs_sha256": inputs}))
    return journal


def end_journal(results: Path) -> None:
    """Removes what only an unfinished run needs."""
    with suppress(FileNotFoundError):
        shutil.rmtree(results / JOURNAL)


def _what_changed(before: object, inputs: dict[str, str]) -> str:
    known = before if isinstance(before, dict) else {}
    changed = sorted(name for name in known.keys() | inputs.keys() if known.get(name) != inputs.get(name))
    if changed:
        more = f" and {len(changed) - 1} other files" if len(changed) > 1 else ""
        return f"was begun before {changed[0]}{more} changed"
    return "was begun with other settings or another version of the program"
