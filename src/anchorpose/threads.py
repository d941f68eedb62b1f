"""Control the number of threads. Results never depend on this number.

Linear algebra and OpenCV use a single thread, so that sums are added in a fixed order and always give the same bytes.
Work that concerns a single camera or person may be done by another thread at the same time as other such work: each
result is computed by one thread alone, and the results are joined in a fixed order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final, TypeVar

from threadpoolctl import threadpool_limits

Result = TypeVar("Result")

# the threads that share the work; None: the caller's thread does all work
_WORKERS: Final = ContextVar[ThreadPoolExecutor | None]("workers", default=None)


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep linear algebra and OpenCV on one thread within the ``with`` block. OpenCV's own threads are not used, since
    they would wait longer than they work.
    """
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(limits=1):
            yield
    finally:
        cv2.setNumThreads(before)


@contextmanager
def worker_threads(count: int) -> Iterator[None]:
    """Let ``each`` share its work among ``count`` threads within the block; if ``count`` is 1, the caller's thread does
    all work.
    """
    if count < 2:
        yield
        return
    with ThreadPoolExecutor(count) as workers:
        before = _WORKERS.set(workers)
        try:
            yield
        finally:
            _WORKERS.reset(before)


def each(work: Callable[..., Result], *arguments: Iterable[object]) -> list[Result]:
    """Call ``work`` with the first item of every argument, with the second item of every argument and so on, on the
    threads of ``worker_threads``; return the results in this order.

    A call of ``work`` must not change data that another call reads. Raises the exception of the first call that fails.
    """
    calls, workers = list(zip(*arguments, strict=True)), _WORKERS.get()
    if workers is None or len(calls) < 2:
        return [work(*call) for call in calls]
    return list(workers.map(lambda call: work(*call), calls))
