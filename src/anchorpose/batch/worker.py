"""Run a job in a child process of the scheduler's worker, and wait for it.

The child does all of the work, so the worker is not affected if the child crashes, leaks memory or is killed. If the
worker is killed, its child ends, too. The worker returns only an ``Outcome``; results are files, so no result is lost
if the worker is killed.

The child reads the work, a pickled call, from its standard input. Unpickling it adds no risk: anyone who may submit a
job to dask can run anything on its workers. Nothing is unpickled from a disk. The input stays open as long as the
worker lives. If the worker is killed, the input ends, and the child stops as if it had received SIGTERM. The data that
the child has stored are kept, so the work can be resumed elsewhere.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

KERNELS: Final = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
ONE_THREAD: Final = dict.fromkeys(KERNELS, "1")
"""Environment variables that make a child process use one core only: several children run at once, one per worker."""

STOP_S: Final = 15.0  # s, maximum wait for a child to end after SIGTERM; longer than ``ABANDONED_STOP_S``
# s from SIGTERM to the forced end of a child whose worker was killed; the child needs time to return from compiled code
# and to delete partial files
ABANDONED_STOP_S: Final = 10.0
ABANDONED: Final = 143  # exit code of a child whose worker was killed, the same as after SIGTERM
TAIL_BYTES: Final = 4096  # bytes at the end of a log in which its last line is searched for


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a job: why it failed (None if it is done), and its duration."""

    name: str
    why: str | None = None
    seconds: float = 0.0


_running: dict[str, list[subprocess.Popen[bytes]]] = {}  # by group of jobs, the children that run on this worker
_stopped: set[str] = set()  # groups of jobs that may start no more children


def run_apart(name: str, work: bytes, log: str | None, group: str) -> Outcome:
    """Run a pickled call in a child process with one thread.

    log: the file to which the child's output is appended, None to discard the output. group: a text that is equal for
    jobs that are stopped together.
    """
    begin = time.monotonic()
    with TemporaryDirectory(prefix="anchorpose-") as folder:
        output = Path(log or Path(folder) / "output")
        output.parent.mkdir(parents=True, exist_ok=True)
        with output.open("ab") as stream, _child(stream, group) as process:
            if process is None:
                return Outcome(name, "was stopped before it began.")
            with suppress(BrokenPipeError):
                process.stdin.write(work)  # type: ignore[union-attr]
                process.stdin.flush()  # type: ignore[union-attr]
            code = process.wait()
        why = None if code == 0 else _why(code, output)
    return Outcome(name, why, time.monotonic() - begin)


@contextmanager
def _child(output: Any, group: str) -> Iterator[subprocess.Popen[bytes] | None]:
    """Yield a started child process; yield None if the jobs of its group were stopped before. The child runs in its own
    session of the operating system, so Ctrl+C in a terminal does not reach the child.
    """
    if group in _stopped:
        yield None
        return
    command = [sys.executable, "-m", "anchorpose.batch.worker"]
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=output,
        stderr=output,
        env={**os.environ, **ONE_THREAD},
        start_new_session=True,
    )
    _running.setdefault(group, []).append(process)
    try:
        yield process
    finally:
        _running[group].remove(process)
        with suppress(BrokenPipeError):
            process.stdin.close()  # type: ignore[union-attr]


def stop_children(group: str) -> None:
    """Stop the child processes that run jobs of a group on this worker, and wait for them at most ``STOP_S`` seconds.
    No further child of the group is started on this worker.
    """
    _stopped.add(group)
    children = tuple(_running.get(group, ()))
    for process in children:
        process.terminate()
    deadline = time.monotonic() + STOP_S
    for process in children:
        with suppress(subprocess.TimeoutExpired):
            process.wait(max(deadline - time.monotonic(), 0.0))


def _why(code: int, output: Path) -> str:
    if code < 0:
        often = ", as where memory is short" if code == -signal.SIGKILL else ""
        return f"was killed by signal {-code}{often}; run it alone to see why."
    return _last_line(output) or f"ended with exit code {code}."


def _last_line(output: Path) -> str:
    """Return the last non-empty line of a log. If a job was refused, this line states why."""
    with output.open("rb") as stream:
        stream.seek(max(output.stat().st_size - TAIL_BYTES, 0))
        lines = stream.read().decode("utf-8", errors="replace").splitlines()
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


def do_work() -> int:
    """Run, in the child, the call that standard input holds, and return the child's exit code."""
    from anchorpose.cli import exit_code_of

    call = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_stop_when_abandoned, daemon=True).start()

    def work() -> None:
        call()  # the return value must not become the exit code

    return exit_code_of(work)


def _stop_when_abandoned() -> None:
    # Wait for the end of the input. A read of sys.stdin would lock the stream, and hold the lock while the process
    # ends, so os.read is used.
    while os.read(sys.stdin.fileno(), 1):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(ABANDONED_STOP_S)
    os._exit(ABANDONED)


if __name__ == "__main__":
    sys.exit(do_work())
