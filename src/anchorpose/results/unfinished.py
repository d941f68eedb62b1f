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
from anchorpose.recording.writable import new_folder
from anchorpose.results.folder import RESULTS, check_results_path, naming_place, publish, write_text_whole

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
    with _claimed(work, path):
        stored = _has_stored(work)
        if stored and not resume and not overwrite:
            raise InputError(path, f"has an unfinished run, in {work}", _remedy(path, go_on))
        if not (stored and resume):
            _clear(work, (LOCK_FILE, MARK_FILE))
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
    try:
        begun = read_json(work / JOURNAL / BEGUN_FILE, LARGEST_WITH_HASHES) if _is_own(work) else {}
    except InputError:
        return None
    identity = begun.get("identity")
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


@contextmanager
def _claimed(work: Path, path: Path) -> Iterator[None]:
    """The folder, made where it is absent, marked and locked; raises InputError where it is not this program's, or
    another run has it."""
    if os.path.lexists(work) and (work.is_symlink() or not work.is_dir()):
        raise InputError(work, "is in the way, and not of an unfinished run", "rename it")
    with new_folder(work, path):
        if not any(work.iterdir()):
            with naming_place(path):
                (work / MARK_FILE).write_text(MARK, encoding="utf-8")
        _require_own(work)
        lock = FileLock(work / LOCK_FILE)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise InputError(path, "is being made by another run", "wait for it, or choose another name") from None
        try:
            yield
        finally:
            lock.release()


def _is_own(work: Path) -> bool:
    try:
        _require_own(work)
    except InputError:
        return False
    return True


def _require_own(work: Path) -> None:
    """Raises InputError unless this program has made the folder, and nothing in it leads out of it."""
    try:
        marked = not work.is_symlink() and read_text(work / MARK_FILE) == MARK
    except InputError:
        marked = False
    if not marked:
        raise InputError(work, "is in the way, and not of an unfinished run", "rename it")
    if link := next((entry for entry in work.rglob("*") if entry.is_symlink()), None):
        raise InputError(link, f"is a link, so that {work.name} is in the way", "put there what it leads to")


def _has_stored(work: Path) -> bool:
    """Whether anything is in the journal besides its beginning, readable or not: what cannot be read is kept, too."""
    journal = work / JOURNAL
    if not journal.is_dir():
        return os.path.lexists(journal)
    names = {entry.name for entry in journal.iterdir() if ".partial" not in entry.name}
    return bool(names - {BEGUN_FILE, FIRST_SECONDS})


def is_live_session(path: Path) -> bool:
    """Return whether the unfinished run into ``path`` is a live session."""
    return _is_live(_work_of(path))


def _is_live(work: Path) -> bool:
    return os.path.lexists(work / JOURNAL / FIRST_SECONDS)


def _remedy(path: Path, go_on: str) -> str:
    begin_again = "to begin again, give --overwrite"
    if begun_identity(path) is None and not is_live_session(path):
        return f"it is damaged: {begin_again}"
    return f"{_going_on(path, go_on)}; {begin_again}"


def _going_on(path: Path, go_on: str) -> str:
    """Return how the run that is stored is continued, as a clause."""
    return f"'anchorpose live --finish -o {path}' finishes it" if is_live_session(path) else f"{go_on} goes on"


def _clear(work: Path, keep: Sequence[str]) -> None:
    for entry in [entry for entry in work.iterdir() if entry.name not in keep]:
        shutil.rmtree(entry) if entry.is_dir() else entry.unlink()


def clear_beside_journal(work: Path) -> None:
    """Removes what a run that goes on writes again: tables and pictures of the one that was stopped."""
    _clear(work, (LOCK_FILE, MARK_FILE, JOURNAL))


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
    InputError where the run that was begun had others, or its journal cannot be read; nothing was changed then.
    """
    journal = results / JOURNAL
    if os.path.lexists(journal):
        _require_same(results, identity, inputs)
        clear_beside_journal(results)
        return journal
    journal.mkdir()
    write_text_whole(journal / BEGUN_FILE, json.dumps({"identity": identity, "inputs_sha256": inputs}))
    return journal


def _require_same(results: Path, identity: str, inputs: dict[str, str]) -> None:
    path, begin_again = results / JOURNAL / BEGUN_FILE, "to begin again, give --overwrite instead of --resume"
    if _is_live(results):
        raise InputError(results, "is a live session", "finish it with 'anchorpose live --finish'")
    try:
        begun = read_json(path, LARGEST_WITH_HASHES)
    except InputError:
        raise InputError(path, "is damaged or missing", begin_again) from None
    if begun.get("identity") != identity:
        raise InputError(results, _what_changed(begun.get("inputs_sha256"), inputs), begin_again)


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
