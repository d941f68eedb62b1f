"""The corrections of one sitting: read from the file, extended by what the page sends, written whole each time.

One change at a time, among programs as well: a lock file beside the file that is changed.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from anchorpose.errors import InputError
from anchorpose.results.corrections import (
    Corrections,
    now_utc,
    parse_correction,
    parse_withdrawal,
    read_corrections,
    require_recording,
    write_corrections,
)
from anchorpose.results.run_record import as_json
from anchorpose.results.tables import JointTable

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


class Correcting:
    """Adds to and takes back from one file; the file is locked and read again for each change, so nobody's work is
    lost, whichever viewer it is done in.

    begun: what holds while there is no file; the first change writes it there too, so that a second round of review
    keeps what the first one found. Raises InputError where the file cannot be used, or is about another recording or
    world.
    """

    def __init__(self, path: Path, begun: Corrections, joints: JointTable) -> None:
        self.path, self.begun = path, begun
        self._time_s = dict(zip(joints.frame.tolist(), joints.time_s.tolist(), strict=True))
        self.current()

    def current(self) -> Corrections:
        """What the file holds now; what it begins with where there is none yet."""
        if not self.path.exists():
            return self.begun
        found = read_corrections(self.path)
        require_recording(self.path, found, self.begun.recording)
        return found

    def add(self, given: dict[str, Any]) -> Corrections:
        """One more correction, without its times and its ``when``, which are put in here; raises InputError."""
        timed = {**given, "when": now_utc()}
        for frame, time_key in (("first_frame", "start_s"), ("last_frame", "end_s"), ("frame", "time_s")):
            if frame in given:
                timed[time_key] = self._time_of(given[frame])
        entry = parse_correction(Path("correction"), timed)
        with locked(self.path):
            after = self.current().added(entry)
            write_corrections(self.path, after)
        return after

    def take_back(self, given: dict[str, Any]) -> Corrections:
        """Moves an ``entry``, given as it stands in the file, to what was withdrawn, by ``who``; raises InputError, or
        ValueError where the entry does not hold."""
        entry, by = parse_withdrawal(Path("correction"), {**given, "when": now_utc()})
        with locked(self.path):
            after = self.current().taken_back(entry, by)
            write_corrections(self.path, after)
        return after

    def _time_of(self, frame: Any) -> float:
        if frame not in self._time_s:
            raise ValueError(f"the results have no frame {frame}")
        return self._time_s[frame]


def shown(corrections: Corrections) -> dict[str, Any]:
    """What holds, as the page reads it."""
    return {"unusable": as_json(corrections.unusable), "joints": as_json(corrections.joints)}
