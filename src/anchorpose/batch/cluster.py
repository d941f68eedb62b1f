"""Run many independent jobs on worker processes of this machine, of a running dask scheduler, or of SLURM.

A job that fails or makes its worker crash does not affect other jobs.
"""

from __future__ import annotations

import logging
import os
import pickle
import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from shutil import which
from typing import TYPE_CHECKING, Any, Final

from anchorpose.batch.worker import Outcome, run_apart, stop_children
from anchorpose.errors import AnchorposeError, MissingPackage

if TYPE_CHECKING:
    from distributed import Client, Future

if find_spec("distributed") is None:
    raise MissingPackage("Work on many recordings at once", "distributed", "batch")

SLURM: Final = "slurm"
ADDRESSES: Final = ("tcp://", "tls://", "ucx://")
CONNECT_S: Final = 20.0  # s, maximum time to connect to a scheduler
# Maximum number of times that a job is repeated after its worker died. A job whose worker dies once more is given up,
# since the job is probably the cause of the deaths, for example because it needs too much memory.
DEATHS: Final = 3

SCHEDULING: Final = {
    "distributed.scheduler.allowed-failures": DEATHS,
    "distributed.comm.timeouts.connect": f"{CONNECT_S:g}s",
}

IGNORE_CTRL_C: Final = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
"""Code that workers of this machine run at their start: they ignore Ctrl+C, so that the main process can stop the
workers' child processes first, and then the workers.
"""


@dataclass(frozen=True, slots=True)
class Place:
    """The machine or scheduler that runs the workers. workers: number of workers to start; None means one per core of
    this machine, or one per job with SLURM. A running scheduler uses the workers that it has. scheduler: None for this
    machine, an address, or ``slurm``; slurm: keyword arguments of dask_jobqueue.SLURMCluster.
    """

    workers: int | None = None
    scheduler: str | None = None
    slurm: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.scheduler not in (None, SLURM) and not str(self.scheduler).startswith(ADDRESSES):
            raise AnchorposeError(
                f"--scheduler is '{self.scheduler}'; give {SLURM}, or the address of a running scheduler, for example "
                "tcp://10.0.0.5:8786."
            )


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def connected(place: Place, jobs: int) -> Iterator[Client]:
    """Yield a client of the scheduler; schedulers and workers that this call starts end with the ``with`` block.

    jobs: maximum number of workers to start. Raises AnchorposeError if the scheduler cannot be reached.
    """
    import dask
    import distributed  # not within ``dask.config.set``, whose end would drop the defaults that this import sets

    with dask.config.set(SCHEDULING):
        logging.getLogger("distributed").setLevel(logging.ERROR)  # no warnings; a job's outcome states why it failed
        if place.scheduler not in (None, SLURM):
            with _running(str(place.scheduler)) as client:
                yield client
            return
        cluster = _slurm(place, jobs) if place.scheduler == SLURM else _local(min(place.workers or cores(), jobs))
        client = distributed.Client(cluster)
        try:
            yield client
        finally:
            # A worker that is being restarted may keep the cluster from closing in time. The TimeoutError that is then
            # raised is ignored: all outcomes are known by then, and the workers end with this process.
            for each in (client, cluster):
                with suppress(TimeoutError):
                    each.close()


def _running(address: str) -> Client:
    from distributed import Client

    try:
        return Client(address, timeout=CONNECT_S)
    except (OSError, ValueError):
        raise AnchorposeError(f"No scheduler answers at {address}; check the address, and that it runs.") from None


def _local(workers: int) -> Any:
    from distributed import LocalCluster

    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",  # any free port, so that several batches can run at once
        memory_limit=0,  # no limit on a worker's memory, since the data are in its child processes
        silence_logs=logging.CRITICAL,
        preload=[IGNORE_CTRL_C],
    )


def _slurm(place: Place, jobs: int) -> Any:
    try:
        from dask_jobqueue import SLURMCluster
    except ImportError:
        raise MissingPackage("--scheduler slurm", "dask-jobqueue", "slurm") from None
    try:
        cluster = SLURMCluster(**{"cores": 1, "processes": 1, "memory": "2GB", **place.slurm})
    except (TypeError, ValueError) as error:
        raise AnchorposeError(f"The settings for SLURM cannot be used ({error}); correct the file.") from None
    if which("sbatch") is None:
        cluster.close()
        raise AnchorposeError("--scheduler slurm needs SLURM's program sbatch; run this where jobs can be submitted.")
    cluster.scale(jobs=min(place.workers or jobs, jobs))
    return cluster


POLL_S: Final = 0.5  # s, maximum time between two calls of ``tick``, and between two checks for new workers

KILLED: Final = (
    f"its worker died {DEATHS + 1} times while it ran; give it more memory or time, or run it alone to see why."
)


@dataclass(frozen=True, slots=True)
class Job:
    """A call to be made in a child process. call: a function that can be pickled by its name; its return value is
    ignored, since its results are files. log: file for the output that the call prints.
    """

    name: str
    call: Callable[[], Any]
    log: Path | None = None


def run_jobs(jobs: Sequence[Job], place: Place, tick: Callable[[], None] = lambda: None) -> Iterator[Outcome]:
    """Run all jobs, beginning with the first listed, and yield the outcome of each job when it ends.

    tick: called about twice a second while jobs run, to show progress. An exception in the caller's loop, such as one
    from Ctrl+C, stops the running jobs; it is raised again after their processes have ended. Raises AnchorposeError if
    the scheduler cannot be used.
    """
    if not jobs:
        return
    group = secrets.token_hex(4)
    with connected(place, len(jobs)) as client:
        try:
            yield from _run(client, jobs, group, tick)
        except BaseException:
            with suppress(Exception):  # an error while stopping the jobs would hide the first error
                client.run(stop_children, group)
            raise


def _run(client: Client, jobs: Sequence[Job], group: str, tick: Callable[[], None]) -> Iterator[Outcome]:
    """Run the jobs and yield their outcomes. The number of submitted jobs is at most the number of the workers'
    threads, since the death of a worker counts as a failure of every job that waits on this worker.

    A future is released once its outcome is known. The scheduler then forgets the job, and does not repeat it if its
    worker dies later.
    """
    from distributed import wait

    waiting = list(enumerate(jobs))[::-1]
    running: dict[Future, str] = {}
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
    """Return the reason why the scheduler gave up a job; None if the job has an outcome."""
    from distributed.scheduler import KilledWorker

    if future.status == "finished":
        return None
    error = future.exception() if future.status == "error" else future.status
    return KILLED if isinstance(error, KilledWorker) else f"cannot be run ({error})."
