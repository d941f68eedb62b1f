"""Open files that come from users or other programs: only regular files, and only up to a maximum size.

Reading from a device, or from a named pipe without a writer, would never end. ``read_whole`` and ``read_bounded`` read
a whole file; ``open_regular`` opens a file that is read in pieces; ``require_regular`` checks a path for a library that
opens it; ``read_arrays`` and ``read_image`` decode files other than depth frames. No module opens an input in another
way; tests/test_structure.py enforces this.
"""

from __future__ import annotations

import errno
import os
import stat
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BufferedReader, FileIO
from pathlib import Path
from threading import Lock
from typing import Any, Final, TypeVar

import numpy as np

from anchorpose.errors import InputError

Found = TypeVar("Found")

# flags for opening a file: never wait for the writer of a pipe, and (on Windows) read bytes unchanged
NEVER_BLOCKS: Final = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)

LARGEST_TABLE: Final = 512 * 2**20
"""Maximum size in bytes of a table as text, or of a C3D file. An hour of 40 points at 100 Hz has 350 MB; its values
take ten times as much memory.
"""

LARGEST_IMAGE: Final = 256 * 2**20
"""Maximum size in bytes of an image file of any kind: 8192 x 8192 incompressible colour pixels."""

LARGEST_ARRAYS: Final = 4 * 2**30
"""Maximum size in bytes of arrays in memory, or of a run's stored state: an hour of joints at 30 Hz has 54 MB."""

AS_STORED: Final = -1  # value of cv2.IMREAD_UNCHANGED

PUT_FILE: Final = "put the file itself there, or remove it"


Stamp = tuple[int, int, int]
"""Size, time of change (ns) and inode of a file. The stamp changes if the file is replaced or written to."""

_ERROR_STREAM: Final = 2  # file descriptor of the standard error stream
_REDIRECTED: Final = Lock()  # held while the error stream is redirected


class Unreadable(Exception):
    """The error for a file that cannot be read. The message ends a sentence that begins with the file's name."""


STAMP: Final = np.dtype([("size", np.int64), ("changed_ns", np.int64), ("inode", np.uint64)])
"""Element type of an array of stamps (see ``list_file``); an array saves memory: an hour of three cameras has 324,000
files.
"""


def list_file(path: Path) -> Stamp:
    """Return the stamp (size, time of change, inode) of a regular file without opening it; raises InputError for
    anything else.
    """
    try:
        return _stamp_of(require_regular(path))
    except FileNotFoundError:
        raise InputError(
            path, "is a link to a file that is not there", "copy the file itself, or remove the link"
        ) from None
    except (OSError, ValueError) as error:
        raise InputError(path, f"cannot be read ({reason(error)})", "check the file and its permissions") from None


def require_regular(path: Path, most_bytes: int | None = None) -> os.stat_result:
    """Return the status of a regular file without opening it, for libraries that open a path themselves.

    Raises OSError if the path does not exist, InputError if it is not a regular file or has more than ``most_bytes``.
    """
    found = path.stat()
    if problem := _not_a_file(found.st_mode):
        raise InputError(path, problem, PUT_FILE)
    if most_bytes is not None and found.st_size > most_bytes:
        raise InputError(path, _too_large(found.st_size, most_bytes), "give the right file")
    return found


def open_regular(path: Path) -> BufferedReader:
    """Open a regular file to be read in pieces; raises OSError as ``open`` does, InputError if it is not regular."""
    try:
        return _open(path)
    except Unreadable as problem:
        raise InputError(path, str(problem), PUT_FILE) from None


def _open(path: Path) -> BufferedReader:
    descriptor = os.open(path, os.O_RDONLY | NEVER_BLOCKS)
    if problem := _not_a_file(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise Unreadable(problem)
    return BufferedReader(_Ended(path, descriptor))


class _Ended(FileIO):
    """A file that raises OSError instead of waiting for content that does not exist yet. Without this class, reading a
    special file such as the system's log would wait for new content.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path = path
        super().__init__(descriptor)

    def readinto(self, buffer: Any) -> int:
        """Read as FileIO does; raises OSError if there is nothing to read yet."""
        return self._there(super().readinto(buffer))

    def readall(self) -> bytes:
        """Read as FileIO does; raises OSError if there is nothing to read yet."""
        return self._there(super().readall())

    def _there(self, found: Found | None) -> Found:
        if found is None:
            raise OSError(errno.ESPIPE, "it has no end", str(self._path))
        return found


def is_there(path: Path) -> bool:
    """Return whether the path exists. A broken link counts as existing, so that it is not taken for an absent file."""
    return os.path.lexists(path)


def read_bounded(path: Path, most_bytes: int, listed: Stamp | None = None) -> bytes:
    """Read a regular file of at most ``most_bytes``; raises Unreadable with the reason.

    listed: the file's stamp (size, time of change, inode) when the run began. Raises InputError if the file was
    replaced since then, because the run would mix two recordings.
    """
    try:
        with _open(path) as file:
            found = os.fstat(file.fileno())
            if listed is not None and _stamp_of(found) != listed:
                raise InputError(path, "was changed or replaced while the recording was read", "start again")
            if found.st_size > most_bytes:
                raise Unreadable(_too_large(found.st_size, most_bytes))
            content = file.read(found.st_size + 1)
            if len(content) > found.st_size:  # the file is growing, or its file system states a size of 0
                content += file.read(most_bytes + 1 - len(content))
    except (OSError, ValueError) as error:
        raise Unreadable(f"cannot be read ({reason(error)})") from None
    if len(content) > most_bytes:
        raise Unreadable(f"has more than {most_bytes:,} bytes")
    return content


def read_whole(path: Path, most_bytes: int, remedy: str) -> bytes:
    """Read a regular file of at most ``most_bytes``; raises InputError with the remedy if the file cannot be read."""
    try:
        return read_bounded(path, most_bytes)
    except Unreadable as problem:
        raise InputError(path, str(problem), remedy) from None


def reason(error: OSError | ValueError) -> str:
    """Return the operating system's text for an OSError, or the text of a ValueError (a path with a null byte)."""
    return getattr(error, "strerror", None) or str(error)


def _stamp_of(found: os.stat_result) -> Stamp:
    return found.st_size, found.st_mtime_ns, found.st_ino


def _too_large(size: int, most_bytes: int) -> str:
    return f"has {size:,} bytes, and such a file has {most_bytes:,} at most"


def _not_a_file(mode: int) -> str:
    """Return the kind of a file that is not a regular file, as the end of a sentence; empty for a regular file."""
    kinds = (
        (stat.S_ISREG, ""),
        (stat.S_ISDIR, "is a folder, not a file"),
        (stat.S_ISFIFO, "is a named pipe, not a file"),
        (stat.S_ISSOCK, "is a socket, not a file"),
    )
    return next((words for is_kind, words in kinds if is_kind(mode)), "is a device, not a file")


def read_arrays(path: Path, names: Sequence[str], remedy: str) -> dict[str, Any]:
    """Read the arrays with these ``names`` that an .npz file has; raises InputError for any other file."""
    try:
        with open_regular(path) as stream, zipfile.ZipFile(stream) as packed:
            size = sum(packed.getinfo(f"{name}.npy").file_size for name in names if f"{name}.npy" in packed.namelist())
            if size > LARGEST_ARRAYS:
                raise ValueError(f"{size:,} bytes unpacked, {LARGEST_ARRAYS:,} at most")
            stream.seek(0)
            with np.load(stream, allow_pickle=False) as file:
                return {name: file[name] for name in names if name in file.files}
    except FileNotFoundError:
        raise InputError(path, "there is no such file", "check the path") from None
    except (OSError, ValueError, zipfile.BadZipFile, zlib.error, EOFError, MemoryError, RuntimeError) as error:
        first = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise InputError(path, f"is not a readable .npz file ({first})", remedy) from None


def read_image(path: Path, flags: int = AS_STORED) -> np.ndarray | None:
    """Read the pixels of an image file with OpenCV; None if the file cannot be read or is damaged."""
    import cv2

    try:
        data = read_bounded(path, LARGEST_IMAGE)
        with _silent_decoders():
            return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except (Unreadable, cv2.error):  # OpenCV raises for an empty file, and for more pixels than it decodes
        return None


@contextmanager
def _silent_decoders() -> Iterator[None]:
    """Discard the messages of libpng and libjpeg about damaged files, which OpenCV's log level does not affect.

    The error stream of the whole process is redirected, so this function must not be used while other threads work.
    """
    with _REDIRECTED, open(os.devnull, "wb") as nothing:
        kept = os.dup(_ERROR_STREAM)
        os.dup2(nothing.fileno(), _ERROR_STREAM)
        try:
            yield
        finally:
            os.dup2(kept, _ERROR_STREAM)
            os.close(kept)
