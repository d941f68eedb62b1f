"""The file of corrections: read, extended by what the page sends, and written whole each time.

One change at a time, among programs as well: a lock file stands beside the file that is changed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from filelock import FileLock, Timeout

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

PATIENCE_S: Final = 10.0
"""A change takes milliseconds: a program that holds the lock this long is stuck."""

POLL_S: Final = 0.005


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Keeps out other threads and programs that lock the same file until the block ends.

    The operating system holds the lock, so that a program that dies leaves none behind; the empty lock file stays.
    Raises InputError where another program holds it for ``PATIENCE_S``, or where no lock is possible.
    """
    lock = FileLock(path.with_name(f".{path.name}.lock"))
    try:
        lock.acquire(timeout=PATIENCE_S, poll_interval=POLL_S)
    except Timeout:
        problem = "is being changed by another program that does not come to an end"
        raise InputError(path, problem, "try again") from None
    except (OSError, NotImplementedError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(path, f"cannot be locked ({why})", "choose another place for it") from None
    try:
        yield
    finally:
        lock.release()


class CorrectionFile:
    """Adds to one file and withdraws from it; the file is locked and read again for each change, so that several
    viewers can work on it at once.

    initial: the corrections while there is no file; the first change writes them as well, so that a second round of
    review keeps those of the first. Raises InputError where the file cannot be used, or is about another recording or
    world.
    """

    def __init__(self, path: Path, initial: Corrections, joints: JointTable) -> None:
        self.path, self.initial = path, initial
        self._time_s = dict(zip(joints.frame.tolist(), joints.time_s.tolist(), strict=True))
        self.current()

    def current(self) -> Corrections:
        """What the file holds now; the initial corrections where there is no file yet."""
        if not self.path.exists():
            return self.initial
        found = read_corrections(self.path)
        require_recording(self.path, found, self.initial.recording)
        return found

    def add(self, given: dict[str, Any]) -> Corrections:
        """Adds a correction, given without its times and its ``when``, which are filled in here; raises InputError."""
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
        """Moves an ``entry``, given as it stands in the file, to the withdrawn ones, by ``who``; raises InputError, or
        ValueError where there is no such entry."""
        withdrawal = parse_withdrawal(Path("correction"), {**given, "when": now_utc()})
        with locked(self.path):
            after = self.current().taken_back(withdrawal)
            write_corrections(self.path, after)
        return after

    def _time_of(self, frame: Any) -> float:
        if frame not in self._time_s:
            raise ValueError(f"the results have no frame {frame}")
        return self._time_s[frame]


def valid_corrections(corrections: Corrections) -> dict[str, Any]:
    """The valid corrections, as the page reads them."""
    return {
        "unusable": as_json(corrections.unusable),
        "joints": as_json(corrections.joints),
        "patient": as_json(corrections.patient),
    }
