"""Work for the tests of batches: quick stand-ins that a child process can do."""

import os
import signal
import time
from pathlib import Path

from anchorpose.batch.sessions import Session
from anchorpose.batch.tracking import track_session
from anchorpose.errors import InputError


def note(folder: Path, name: str) -> None:
    """Appends one line to the file of this name, so that a test can count how often it was done."""
    with (folder / name).open("a") as stream:
        stream.write(f"{os.getpid()}\n")


def refuse(folder: Path, name: str) -> None:
    """Ends as a recording that cannot be used does."""
    note(folder, name)
    raise InputError(folder / name, "is not a recording", "give another")


def be_killed(folder: Path, name: str) -> None:
    """Ends as where the system is short of memory."""
    note(folder, name)
    os.kill(os.getpid(), signal.SIGKILL)


def wait_for(folder: Path, name: str, until: Path) -> None:
    """Waits until a file is there, noting when it is stopped."""
    note(folder, name)
    try:
        while not until.exists():
            time.sleep(0.05)
    except KeyboardInterrupt:
        (folder / f"{name}.stopped").touch()
        raise


def track_counted(folder: Path, session: Session, results: Path) -> bool:
    """Tracks a session, and notes that it was begun."""
    note(folder, session.name)
    return track_session(session, results)


def threads(path: Path) -> None:
    """Writes what the environment allows libraries."""
    path.write_text(f"{os.environ.get('NUMBA_NUM_THREADS')} {os.environ.get('OMP_NUM_THREADS')}")
