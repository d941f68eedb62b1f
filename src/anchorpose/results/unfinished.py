"""A results folder that is being made: a run that was stopped or killed goes on in it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from filelock import FileLock, Timeout

from anchorpose.errors import InputError
from anchorpose.recording.document import LARGEST_WITH_HASHES, read_json
from anchorpose.results.folder import RESULTS, check_results_path, make_folder, naming_place, publish, write_text_whole

JOURNAL: Final = "journal"
"""The folder in an unfinished results folder that holds what the run has done so far."""

LIVE: Final = "live session"
"""How the identity of a live session begins: it cannot be tracked again, only finished."""

FIRST_SECONDS: Final = "first-seconds"
"""The folder in a journal that holds the first seconds of a live session; alone, they are not worth keeping."""

BEGUN_FILE: Final = "begun.json"
LOCK_FILE: Final = ".lock"


@contextmanager
def unfinished_results(
    path: Path, recording: Path | None, overwrite: bool = False, resume: bool = False
) -> Iterator[Path]:
    """The folder ``.NAME.unfinished`` beside ``path``, which becomes ``path`` when the block ends without an error.

    Otherwise it stays, if the run has stored anything in it, and ``resume`` goes on with it. It is locked: a second
    run into ``path`` at the same time is refused. recording: None where the images come from cameras. Raises InputError
    before anything is written where results may not go to ``path`` or an unfinished run is there and neither ``resume``
    nor ``overwrite`` is given.
    """
    check_results_path(path, recording, overwrite)
    work = _work_of(path)
    if not work.is_dir():
        make_folder(work, path)
    with _locked(work, path):
        stored = _has_stored(work)
        if stored and not resume and not overwrite:
            remedy = f"{_going_on(path)}, or give --overwrite to begin again"
            raise InputError(path, f"has an unfinished run, in {work}", remedy)
        _clear(work, keep=(LOCK_FILE, JOURNAL) if stored and resume else (LOCK_FILE,))
        try:
            with naming_place(path):
                yield work
                (work / LOCK_FILE).unlink()
                publish(work, path, RESULTS.own if overwrite else ())
        except BaseException as error:
            _leave(work, path, error)
            raise


def begun_identity(path: Path) -> str | None:
    """The identity of the unfinished run into ``path``; None where there is none, or it cannot be read."""
    begun = _work_of(path) / JOURNAL / BEGUN_FILE
    try:
        identity = read_json(begun).get("identity") if begun.is_file() else None
    except InputError:
        return None
    return identity if isinstance(identity, str) else None


def wait_until_free(path: Path, timeout_s: float) -> None:
    """Waits while another run writes into ``path``, at most ``timeout_s``; a killed one takes a moment to end."""
    work = _work_of(path)
    if work.is_dir():
        with suppress(Timeout), FileLock(work / LOCK_FILE, timeout=timeout_s):
            pass


def _work_of(path: Path) -> Path:
    target = path.resolve()
    return target.parent / f".{target.name}.unfinished"


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
    files = [file for file in (work / JOURNAL).rglob("*") if file.is_file()]
    return any(file.name != BEGUN_FILE and FIRST_SECONDS not in file.parts for file in files)


def is_live_session(path: Path) -> bool:
    """Whether the unfinished run into ``path`` is a live session."""
    return (begun_identity(path) or "").startswith(LIVE)


def _going_on(path: Path) -> str:
    """What the user does to go on with the run that is stored."""
    live = f"finish it with 'anchorpose live --finish -o {path}'"
    return live if is_live_session(path) else "give the same command with --resume"


def _clear(work: Path, keep: Sequence[str]) -> None:
    for entry in [entry for entry in work.iterdir() if entry.name not in keep]:
        shutil.rmtree(entry) if entry.is_dir() else entry.unlink()


def _leave(work: Path, path: Path, error: BaseException) -> None:
    """Removes what is of no use any more, else notes how to go on."""
    if _has_stored(work):
        error.add_note(f"What was done is kept: {_going_on(path)}.")
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
        begun = read_json(path, LARGEST_WITH_HASHES)
        if str(begun.get("identity")).startswith(LIVE):
            raise InputError(results, "is a live session", "finish it with 'anchorpose live --finish'")
        if begun.get("identity") != identity:
            raise InputError(results, _what_changed(begun.get("inputs_sha256"), inputs), "begin again with --overwrite")
        return journal
    shutil.rmtree(journal, ignore_errors=True)
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
