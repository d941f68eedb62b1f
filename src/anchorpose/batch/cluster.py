"""Where jobs run: workers on this machine, a scheduler that runs already, or jobs of SLURM."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from anchorpose.errors import AnchorposeError, MissingPackage

if TYPE_CHECKING:
    from distributed import Client

SLURM: Final = "slurm"
ADDRESSES: Final = ("tcp://", "tls://", "ucx://")
CONNECT_S: Final = 20.0
DEATHS: Final = 3  # of its worker that a job survives; more is its own doing, such as too little memory

SCHEDULING: Final = {
    "distributed.scheduler.allowed-failures": DEATHS,
    "distributed.comm.timeouts.connect": f"{CONNECT_S:g}s",
}

IGNORE_CTRL_C: Final = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
"""In the workers of this machine: the first process stops them, after their children."""


@dataclass(frozen=True, slots=True)
class Place:
    """workers: how many, None for one per core (with a running scheduler, all that it has). scheduler: None for this
    machine, an address, or ``slurm``; slurm: keyword arguments of dask_jobqueue.SLURMCluster."""

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
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def connected(place: Place, jobs: int) -> Iterator[Client]:
    """A client of the scheduler; what was started for it ends with the block.

    jobs: no more workers than that are started. Raises AnchorposeError where the scheduler cannot be reached.
    """
    import dask

    with dask.config.set(SCHEDULING):
        logging.getLogger("distributed").setLevel(logging.ERROR)  # what matters comes back with the outcomes
        if place.scheduler is None:
            with _client_of(_local(min(place.workers or cores(), jobs))) as client:
                yield client
        elif place.scheduler == SLURM:
            with _client_of(_slurm(place, jobs)) as client:
                yield client
        else:
            with _running(place.scheduler) as client:
                yield client


@contextmanager
def _client_of(cluster: Any) -> Iterator[Client]:
    """A client of a cluster that was started here, and closed at the end.

    A worker that is being started again may keep the cluster from closing in time. That is no error of the work: all
    outcomes are known by then, and the workers end with this process.
    """
    from distributed import Client

    client = Client(cluster)
    try:
        yield client
    finally:
        for each in (client, cluster):
            with suppress(TimeoutError):
                each.close()


@contextmanager
def _running(address: str) -> Iterator[Client]:
    from distributed import Client

    try:
        client = Client(address, timeout=CONNECT_S)
    except (OSError, ValueError):
        raise AnchorposeError(f"No scheduler answers at {address}; check the address, and that it runs.") from None
    with client:
        yield client


def _local(workers: int) -> Any:
    from distributed import LocalCluster

    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",  # any free port: several batches at once
        memory_limit=0,  # the worker itself holds nothing
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
    cluster.scale(jobs=min(place.workers or jobs, jobs))
    return cluster
