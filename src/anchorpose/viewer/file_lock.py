"""One change at a time, among programs as well: a lock file beside the file that is changed."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

PATIENCE_S: Final = 10.0
"""A change takes milliseconds: whoever holds the lock for so long is stuck."""

PAUSE_S: Final = 0.005


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Keeps other threads and programs that ask the same out until the block ends; raises InputError where that takes
    too long or the place knows no locks.

    The operating system holds the lock, so that a program that dies leaves none behind; the empty lock file stays,
    since taking it away could give two programs two locks.
    """
    try:
        file = os.open(path.with_name(f".{path.name}.lock"), os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        raise InputError(path, f"cannot be changed ({error.strerror})", "choose another place for it") from None
    try:
        _wait_for(file, path)
        yield
    finally:
        os.close(file)  # which ends the lock


def _wait_for(file: int, path: Path) -> None:
    end = time.monotonic() + PATIENCE_S
    while not _lock(file, path):
        if time.monotonic() > end:
            raise InputError(path, "is being changed by another program that does not come to an end", "try again")
        time.sleep(PAUSE_S)


def _lock(file: int, path: Path) -> bool:
    """Whether the lock is ours now."""
    try:
        if sys.platform == "win32":
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError as error:
        raise InputError(path, f"cannot be locked ({error.strerror})", "choose another place for it") from None
    return True
