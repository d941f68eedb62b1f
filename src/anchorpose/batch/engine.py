"""Many independent jobs on the workers of a dask scheduler; one that fails, or kills its worker, fails alone."""

from __future__ import annotations

import pickle
import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from anchorpose.batch.cluster import DEATHS, Place, connected
from anchorpose.batch.worker import Outcome, run_apart, stop_children
from anchorpose.errors import MissingPackage

try:
    from distributed import Client, Future, wait
    from distributed.scheduler import KilledWorker
except ImportError:
    raise MissingPackage("Work on many recordings at once", "distributed", "batch") from None

POLL_S: Final = 0.5  # after which new workers are noticed

KILLED: Final = (
    f"its worker died {DEATHS + 1} times while it ran; give it more memory or time, or run it alone to see why."
)


@dataclass(frozen=True, slots=True)
class Job:
    """A call that a child process makes. call: picklable by the name of its function; what it returns is dropped, its
    results are files. log: the file for what it prints."""

    name: str
    call: Callable[[], Any]
    log: Path | None = None


def run_jobs(jobs: Sequence[Job], place: Place, tick: Callable[[], None] = lambda: None) -> Iterator[Outcome]:
    """Runs all jobs, those listed first begin first, and gives the outcome of each as it ends.

    tick: called about twice a second while jobs run, for progress that can be seen from outside of them.
    An exception in the caller's loop, such as that of a signal, stops the jobs that run; their processes have ended
    when it comes out. Raises AnchorposeError where the scheduler cannot be used.
    """
    if not jobs:
        return
    group = secrets.token_hex(4)
    with connected(place, len(jobs)) as client:
        try:
            yield from _run(client, jobs, group, tick)
        except BaseException:
            with suppress(Exception):  # whatever keeps it from stopping, the first error counts
                client.run(stop_children, group)
            raise


def _run(client: Client, jobs: Sequence[Job], group: str, tick: Callable[[], None]) -> Iterator[Outcome]:
    """No more jobs are handed over than there are threads: one that waits on a worker would share in its death.

    A future is let go with its outcome. The scheduler forgets the job then, so that no death of a worker repeats it.
    """
    waiting, running = list(enumerate(jobs))[::-1], dict[Future, str]()
    while waiting or running:
        threads = sum(client.nthreads().values())
        while waiting and len(running) < max(threads, 1):
            number, job = waiting.pop()
            running[_submit(client, job, number, group)] = job.name
        with suppress(TimeoutError):
            wait(list(running), timeout=POLL_S, return_when="FIRST_COMPLETED")
        tick()
        for future in [future for future in running if future.done()]:
            name, why = running.pop(future), _why(future)
            outcome = Outcome(name, why) if why else future.result()
            future.release()
            yield outcome


def _submit(client: Client, job: Job, number: int, group: str) -> Future:
    log = None if job.log is None else str(job.log.resolve())
    key = f"{job.name}-{group}-{number}"
    return client.submit(run_apart, job.name, pickle.dumps(job.call), log, group, key=key, pure=False, priority=-number)


def _why(future: Future) -> str | None:
    """Why the scheduler gave a job up; None where it has its outcome."""
    if future.status == "finished":
        return None
    error = future.exception() if future.status == "error" else future.status
    return KILLED if isinstance(error, KilledWorker) else f"cannot be run ({error})."
