"""Opening every file that comes from a user or another program: regular files only, up to a bound on their size.

A named pipe without a writer would stop the run for ever, and a device has no end. ``read_whole`` and ``read_bounded``
read a whole file; ``open_regular`` opens one that is read in pieces; ``require_regular`` comes before a library that
opens a path itself. No module opens an input otherwise (tests/test_structure.py).
"""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError

NEVER_BLOCKS: Final = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)

LARGEST_TABLE: Final = 512 * 2**20
"""Bytes of a table as text, or of a C3D. An hour of 40 points at 100 Hz has 350 MB; its values take ten times that."""

LARGEST_IMAGE: Final = 256 * 2**20
"""Bytes of an image file of any kind: 8192 x 8192 colour pixels that cannot be compressed."""

LARGEST_ARRAYS: Final = 4 * 2**30
"""Bytes of arrays in memory, or of a stored state of a run: an hour of true joints at 30 Hz has 54 MB."""

PUT_FILE: Final = "put the file itself there, or remove it"


class Unreadable(Exception):
    """Why a file is not read, as the end of a sentence that begins with its name."""


@dataclass(frozen=True, slots=True)
class FileStamp:
    """By what a file is recognised that was replaced or written to since it was listed."""

    size: int
    changed_ns: int
    inode: int


STAMP: Final = np.dtype([("size", np.int64), ("changed_ns", np.int64), ("inode", np.uint64)])
"""A ``FileStamp`` in an array: an hour has 324,000 files."""


def stamp_of(found: os.stat_result) -> FileStamp:
    """The stamp of a file by its status."""
    return FileStamp(found.st_size, found.st_mtime_ns, found.st_ino)


def list_file(path: Path) -> FileStamp:
    """Return the stamp of a regular file, which is not opened; raises InputError for anything else."""
    try:
        return stamp_of(require_regular(path))
    except FileNotFoundError:
        raise InputError(
            path, "is a link to a file that is not there", "copy the file itself, or remove the link"
        ) from None
    except (OSError, ValueError) as error:
        raise InputError(path, f"cannot be read ({reason(error)})", "check the file and its permissions") from None


def require_regular(path: Path, most_bytes: int | None = None) -> os.stat_result:
    """Return the status of a regular file, which is not opened: for libraries that open a path themselves.

    Raises OSError where there is none, InputError where it is anything else or has more than ``most_bytes``.
    """
    found = path.stat()
    if problem := _not_a_file(found.st_mode):
        raise InputError(path, problem, PUT_FILE)
    if most_bytes is not None and found.st_size > most_bytes:
        raise InputError(path, _too_large(found.st_size, most_bytes), "give the right file")
    return found


def open_regular(path: Path) -> BufferedReader:
    """Open a regular file to be read in pieces; raises OSError as ``open``, InputError where it is anything else."""
    descriptor = os.open(path, os.O_RDONLY | NEVER_BLOCKS)
    problem = _not_a_file(os.fstat(descriptor).st_mode)
    if problem:
        os.close(descriptor)
        raise InputError(path, problem, PUT_FILE)
    return open(descriptor, "rb")


def is_there(path: Path) -> bool:
    """Whether anything has this name: also a link that leads nowhere, which must not pass for an absent file."""
    return os.path.lexists(path)


def read_bounded(path: Path, most_bytes: int, listed: FileStamp | None = None) -> bytes:
    """The content of a regular file of at most so many bytes; raises Unreadable with the reason.

    listed: its stamp when the run began. Raises InputError where it is another file by now: the run would mix two
    recordings.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | NEVER_BLOCKS)
    except (OSError, ValueError) as error:
        raise Unreadable(f"cannot be read ({reason(error)})") from None
    try:
        content = _content(path, descriptor, most_bytes, listed)
    except OSError as error:
        raise Unreadable(f"cannot be read ({reason(error)})") from None
    finally:
        os.close(descriptor)
    if len(content) > most_bytes:  # some file systems state a size of 0
        raise Unreadable(f"has more than {most_bytes:,} bytes")
    return content


def _content(path: Path, descriptor: int, most_bytes: int, listed: FileStamp | None) -> bytes:
    """Up to one byte more than may be; its status is that of the very file that is read."""
    found = os.fstat(descriptor)
    if problem := _not_a_file(found.st_mode):
        raise Unreadable(problem)
    if listed is not None and stamp_of(found) != listed:
        raise InputError(path, "was changed or replaced while the recording was read", "start again")
    if found.st_size > most_bytes:
        raise Unreadable(_too_large(found.st_size, most_bytes))
    with open(descriptor, "rb", closefd=False) as file:
        return file.read(most_bytes + 1)


def read_whole(path: Path, most_bytes: int, remedy: str) -> bytes:
    """As ``read_bounded``, and raises InputError with the remedy where the file is not read."""
    try:
        return read_bounded(path, most_bytes)
    except Unreadable as problem:
        raise InputError(path, str(problem), remedy) from None


def _too_large(size: int, most_bytes: int) -> str:
    return f"has {size:,} bytes, and such a file has {most_bytes:,} at most"


def reason(error: OSError | ValueError) -> str:
    """What the system has against a file, in its own words; a name with a null byte is a ValueError."""
    return getattr(error, "strerror", None) or str(error)


def _not_a_file(mode: int) -> str:
    """What a path is that is not a regular file; empty where it is one."""
    kinds = (
        (stat.S_ISREG, ""),
        (stat.S_ISDIR, "is a folder, not a file"),
        (stat.S_ISFIFO, "is a named pipe, not a file"),
        (stat.S_ISSOCK, "is a socket, not a file"),
    )
    return next((words for is_kind, words in kinds if is_kind(mode)), "is a device, not a file")
