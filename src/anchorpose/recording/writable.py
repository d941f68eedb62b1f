"""Check before any work begins whether a path may be written, and write each file completely or not at all.

The checks of this module ensure that recordings, inputs and the user's files are never changed.
"""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.recording.regular_file import open_regular

# the scheme before the colon (such as http) has at least two letters, since "C:/" is a Windows drive
ADDRESS: Final = re.compile(r"[a-z][a-z0-9+.-]+:/", re.IGNORECASE)

RECORDING_MARKS: Final = ("recording.json", "recording.unfinished.json")  # files that show that a folder is a recording

BEGINNING: Final = 4096  # number of first bytes of a file that may contain the mark of an earlier output


def check_place(path: Path, *inputs: Path | None, of_recording: bool = False) -> None:
    """Raise InputError if the path may not be written: if it is an address (URL), the root of the disk, a link, or
    inside a recording; or if it is one of the ``inputs``, lies inside an input or contains one.

    of_recording: the output is a part of a recording, so it may lie in a recording.
    """
    if ADDRESS.match(str(path)):
        problem, remedy = "is an address", "give a local path; only 'anchorpose track' writes to an address"
        raise InputError(str(path).replace(":/", "://", 1), problem, remedy)
    if path.is_symlink():
        raise InputError(path, "is a link", "give the target of the link, or another name")
    target = path.resolve()
    if not target.name:
        raise InputError(path, "is the root of the disk", "choose a folder in it")
    for folder in target.parents:
        if not of_recording and any(os.path.isfile(folder / mark) for mark in RECORDING_MARKS):
            raise InputError(path, f"lies inside the recording {folder}", "choose a place outside of it")
    for source in (given.resolve() for given in inputs if given is not None):
        if target == source:
            raise InputError(path, "is given twice", "choose another name for what is written")
        if target.is_relative_to(source):
            raise InputError(path, f"lies inside {source}, which is used", "choose a place outside of it")
        if source.is_relative_to(target):
            raise InputError(path, f"holds {source}, which is used", "choose another name")


def check_file(path: Path, mark: str, *inputs: Path | None, of_recording: bool = False) -> None:
    """Raise InputError if the file may not be written: for the reasons of ``check_place``, or because an existing
    file is not an earlier output, which has ``mark`` in its first 4,096 bytes.
    """
    check_place(path, *inputs, of_recording=of_recording)
    if os.path.lexists(path) and not _begins_with(path, mark):
        raise InputError(path, "exists already, with other content", "choose another name; nothing was changed")


def _begins_with(path: Path, mark: str) -> bool:
    """Return whether a file is empty or has the mark in its first bytes."""
    try:
        with open_regular(path) as file:
            beginning = file.read(BEGINNING)
    except (InputError, OSError):
        return False
    return not beginning or mark.encode() in beginning


@contextmanager
def new_folder(folder: Path, path: Path) -> Iterator[None]:
    """Make a folder and its missing parents. If the ``with`` block raises, folders made here that are still empty are
    removed.

    Raises InputError if a folder cannot be made; the message names ``path``, the path that the user gave.
    """
    made = [each for each in (folder, *folder.parents) if not os.path.lexists(each)]
    try:
        _make(folder, path)
        yield
    except BaseException:
        for each in made:
            with suppress(OSError):  # keep a folder that is not empty
                each.rmdir()
        raise


def _make(folder: Path, path: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(path, f"cannot be made ({error.strerror})", "choose a place that you may write to") from None


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield the path of a temporary file to be written, which replaces ``path`` when the ``with`` block ends without an
    error, and is removed otherwise. Messages about errors of the disk name ``path``, not the temporary file.
    """
    partial = path.with_name(f".{path.name}.partial-{secrets.token_hex(4)}")
    try:
        yield partial
        partial.replace(path)
    except BaseException as error:
        with suppress(OSError):
            partial.unlink()
        if isinstance(error, OSError) and error.filename in (None, str(partial)):
            error.filename, error.filename2 = str(path), None
        raise
