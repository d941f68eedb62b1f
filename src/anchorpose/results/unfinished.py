"""Write results into an unfinished folder, and resume a run that was stopped or killed.

An unfinished folder is recognised by a file in it, not by its name: a folder without that file (``MARK_FILE``), or with
a link in it, is never touched.
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
"""Name of the folder in an unfinished results folder that holds the run's progress so far."""

EARLIER: Final = "earlier"
"""Name of an overwritten run's journal. This journal is restored if the new run ends before it stores anything."""

LIVE: Final = "live session"
"""Prefix of the identity of a live session. A live session cannot be tracked again, only finished."""

FIRST_SECONDS: Final = "first-seconds"
"""Folder in a journal with the first seconds of a live session; a journal that contains nothing else is not kept."""

BEGUN_FILE: Final = "begun.json"  # file in a journal with the run's identity and the hashes of its inputs
LOCK_FILE: Final = ".lock"  # file that a run locks while it writes into its unfinished folder
MARK_FILE: Final = ".anchorpose"  # file with the text ``MARK`` by which an unfinished folder is recognised
MARK: Final = json.dumps({"format": "anchorpose-unfinished", "version": 1})

RESUME: Final = "the same command with --resume"


@contextmanager
def unfinished_results(
    path: Path, recording: Path | None, overwrite: bool = False, resume: bool = False, go_on: str = RESUME
) -> Iterator[Path]:
    """Yield the folder ``.NAME.unfinished`` beside ``path``, which becomes ``path`` when the ``with`` block ends
    without an error.

    After an error the folder stays if the run has stored anything in it; ``resume`` then continues the run. An
    unfinished run that ``overwrite`` replaces is kept until the new run has stored something. The folder is locked: a
    second run into ``path`` at the same time is refused. recording: None if the images come from cameras. go_on: text
    that states the command with which a stopped run is resumed. Raises InputError, before anything is written, if
    results may not be written to ``path``, if another folder is called ``.NAME.unfinished``, or if an unfinished run
    exists and neither ``resume`` nor ``overwrite`` is given.
    """
    check_results_path(path, recording, overwrite)
    work = _work_of(path)
    with _claimed(work, path):
        _keep_one_journal(work)
        stored = _has_stored(work / JOURNAL)
        if stored and not resume and not overwrite:
            raise InputError(path, f"has an unfinished run, in {work}", _remedy(path, go_on))
        if not stored:
            _clear(work, (LOCK_FILE, MARK_FILE))
        elif not resume:
            (work / JOURNAL).rename(work / EARLIER)
        try:
            with naming_place(path):
                yield work
                for name in (LOCK_FILE, MARK_FILE, EARLIER):
                    _remove(work / name)
                publish(work, path, RESULTS.own if overwrite else ())
        except BaseException as error:
            _leave(work, error, go_on, path)
            raise


def begun_identity(path: Path) -> str | None:
    """Return the identity of the unfinished run into ``path``: a hash of inputs, settings and code, or for a live
    session a text that begins with ``LIVE``; None if no unfinished run exists, or its identity cannot be read.
    """
    work = _work_of(path)
    try:
        begun = read_json(_journal_of(work) / BEGUN_FILE, LARGEST_WITH_HASHES) if _is_own(work) else {}
    except InputError:
        return None
    identity = begun.get("identity")
    return identity if isinstance(identity, str) else None


def wait_until_free(path: Path, timeout_s: float) -> None:
    """Wait at most ``timeout_s`` while another run writes into ``path``; a killed run takes a moment to end."""
    work = _work_of(path)
    if _is_own(work):
        with suppress(Timeout), FileLock(work / LOCK_FILE, timeout=timeout_s):
            pass


def _work_of(path: Path) -> Path:
    target = path.resolve()
    return target.parent / f".{target.name}.unfinished"


@contextmanager
def _claimed(work: Path, path: Path) -> Iterator[None]:
    """Make the unfinished folder ``work`` if it is absent, mark it, and lock it during the ``with`` block. Raises
    InputError if ``work`` was not made by this program, or is in use by another run.
    """
    if os.path.lexists(work) and (work.is_symlink() or not work.is_dir()):
        raise InputError(work, "is in the way, and is not an unfinished run", "rename it")
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
    with suppress(InputError):
        _require_own(work)
        return True
    return False


def _require_own(work: Path) -> None:
    """Raise InputError unless this program has made the folder and no link is in it."""
    marked = False
    with suppress(InputError):
        marked = not work.is_symlink() and read_text(work / MARK_FILE) == MARK
    if not marked:
        raise InputError(work, "is in the way, and is not an unfinished run", "rename it")
    if link := next((entry for entry in work.rglob("*") if entry.is_symlink()), None):
        raise InputError(link, f"is a link, so that {work.name} is in the way", "put the target of the link there")


def _journal_of(work: Path) -> Path:
    """Return the journal (the folder with a run's progress) that is valid at present: the overwritten run's journal
    until the new run has stored something, then the new run's journal.
    """
    new, earlier = work / JOURNAL, work / EARLIER
    return earlier if os.path.lexists(earlier) and not _has_stored(new) else new


def _keep_one_journal(work: Path) -> bool:
    """Remove the journal (the folder with a run's progress) that is not valid; return whether the overwritten run's
    journal was restored.
    """
    restored = _journal_of(work) == work / EARLIER
    if restored:
        _remove(work / JOURNAL)
        (work / EARLIER).rename(work / JOURNAL)
    else:
        _remove(work / EARLIER)
    return restored


def _has_stored(journal: Path) -> bool:
    """Return whether a journal holds progress of a run: complete files or folders other than ``BEGUN_FILE`` (the run's
    identity) and ``FIRST_SECONDS`` (the first seconds of a live session). A journal that is not a folder counts too, so
    that it is kept.
    """
    if not journal.is_dir():
        return os.path.lexists(journal)
    names = {entry.name for entry in journal.iterdir() if ".partial" not in entry.name}
    return bool(names - {BEGUN_FILE, FIRST_SECONDS})


def is_live_session(path: Path) -> bool:
    """Return whether the unfinished run into ``path`` is a live session, which tracks connected cameras."""
    return os.path.lexists(_journal_of(_work_of(path)) / FIRST_SECONDS)


def _remedy(path: Path, go_on: str) -> str:
    begin_again = "to begin again, give --overwrite"
    if begun_identity(path) is None and not is_live_session(path):
        return f"it is damaged: {begin_again}"
    return f"{_going_on(path, go_on)}; {begin_again}"


def _going_on(path: Path, go_on: str) -> str:
    """Return the text, part of a message, that states how to continue the unfinished run."""
    return f"'anchorpose live --finish -o {path}' finishes it" if is_live_session(path) else f"{go_on} goes on"


def _clear(work: Path, keep: Sequence[str]) -> None:
    for entry in [entry for entry in work.iterdir() if entry.name not in keep]:
        _remove(entry)


def _remove(entry: Path) -> None:
    """Remove a file or a folder, if it exists."""
    if entry.is_dir():
        shutil.rmtree(entry)
    else:
        entry.unlink(missing_ok=True)


def clear_beside_journal(work: Path) -> None:
    """Remove files that a resumed run does not need: tables and pictures of a stopped run, which are written again, and
    the journal (the progress) of an overwritten run. Call this function only after all inputs have been accepted.
    """
    _clear(work, (LOCK_FILE, MARK_FILE, JOURNAL))


def _leave(work: Path, error: BaseException, go_on: str, path: Path) -> None:
    """Remove the unfinished folder if no run has stored anything in it; else add to ``error`` how to resume the run,
    unless the error states a remedy.
    """
    restored = _keep_one_journal(work)
    if _has_stored(work / JOURNAL):
        what = "The unfinished run that was there" if restored else "What was done"
        if not isinstance(error, AnchorposeError):
            error.add_note(f"{what} is kept: {_going_on(path, go_on)}.")
    elif work.is_dir():
        shutil.rmtree(work, ignore_errors=True)


def begin_journal(results: Path, identity: str, inputs: dict[str, str]) -> Path:
    """Return the journal, the folder for a run's progress, in an unfinished results folder: a new journal, or the
    journal of an earlier run with the same identity.

    identity: hash of inputs, settings and code, or for a live session a text that begins with ``LIVE``; inputs: the
    hash of each file by its path in the recording. Raises InputError, without changing anything, if the unfinished run
    had other inputs, settings or code, or its journal cannot be read.
    """
    journal = results / JOURNAL
    if os.path.lexists(journal):
        _require_same(results, identity, inputs)
        return journal
    journal.mkdir()
    write_text_whole(journal / BEGUN_FILE, json.dumps({"identity": identity, "inputs_sha256": inputs}))
    return journal


def _require_same(results: Path, identity: str, inputs: dict[str, str]) -> None:
    path, begin_again = results / JOURNAL / BEGUN_FILE, "to begin again, give --overwrite instead of --resume"
    if os.path.lexists(results / JOURNAL / FIRST_SECONDS):
        raise InputError(results, "is a live session", "finish it with 'anchorpose live --finish'")
    try:
        begun = read_json(path, LARGEST_WITH_HASHES)
    except InputError:
        raise InputError(path, "is damaged or missing", begin_again) from None
    if begun.get("identity") != identity:
        raise InputError(results, _what_changed(begun.get("inputs_sha256"), inputs), begin_again)


def end_journal(results: Path) -> None:
    """Remove the journal (the folder with the run's progress), which only an unfinished run needs."""
    _remove(results / JOURNAL)


def _what_changed(before: object, inputs: dict[str, str]) -> str:
    known = before if isinstance(before, dict) else {}
    changed = sorted(name for name in known.keys() | inputs.keys() if known.get(name) != inputs.get(name))
    if changed:
        more = f" and {len(changed) - 1} other files" if len(changed) > 1 else ""
        return f"was begun before {changed[0]}{more} changed"
    return "was begun with other settings or another version of the program"
