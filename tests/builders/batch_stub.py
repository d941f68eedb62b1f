"""Work for the tests of batches: quick stand-ins that a child process can do."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from anchorpose.batch.sessions import Session
from anchorpose.batch.tracking import track_session
from anchorpose.errors import InputError


def note(folder: Path, name: str) -> int:
    """Appends one line to the file of this name, so that a test can count how often it was done; returns its lines."""
    with (folder / name).open("a") as stream:
        stream.write(f"{os.getpid()}\n")
    return (folder / name).read_text().count("\n")


def refuse(folder: Path, name: str) -> None:
    """Ends as a recording that cannot be used does."""
    note(folder, name)
    raise InputError(folder / name, "is not a recording", "give another")


def be_killed(folder: Path, name: str) -> None:
    """Ends as where the system is short of memory."""
    note(folder, name)
    os.kill(os.getpid(), signal.SIGKILL)


def wait_for(folder: Path, name: str, until: Path) -> int:
    """Waits until a file is there, noting when it is stopped; returns how often it has been done."""
    count = note(folder, name)
    try:
        while not until.exists():
            time.sleep(0.05)
    except KeyboardInterrupt:
        (folder / f"{name}.stopped").touch()
        raise
    return count


def track_counted(folder: Path, session: Session, results: Path) -> bool:
    """Tracks a session, and notes that it was begun."""
    note(folder, session.name)
    return track_session(session, results)


def threads() -> tuple[str | None, str | None]:
    """What the environment allows libraries."""
    return os.environ.get("NUMBA_NUM_THREADS"), os.environ.get("OMP_NUM_THREADS")
