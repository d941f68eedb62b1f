"""One thread for everything: sums added in a fixed order give the same bytes on every machine.

Work that each camera needs by itself may run in a thread a camera: nothing is added up between them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

Result = TypeVar("Result")

_CAMERA_THREADS: ContextVar[ThreadPoolExecutor | None] = ContextVar("camera_threads", default=None)


@contextmanager
def camera_threads(count: int) -> Iterator[None]:
    """Let ``for_each_camera`` use so many threads; the results are the same."""
    if count < 2:
        yield
        return
    with ThreadPoolExecutor(count, thread_name_prefix="camera") as threads:
        token = _CAMERA_THREADS.set(threads)
        try:
            yield
        finally:
            _CAMERA_THREADS.reset(token)


def for_each_camera(work: Callable[..., Result], *of_cameras: Iterable[Any]) -> list[Result]:
    """``work`` with the values of each camera, in the order of the cameras; raises what ``work`` raises.

    Inside ``camera_threads`` the cameras are worked on at the same time.
    """
    threads = _CAMERA_THREADS.get()
    return list((map if threads is None else threads.map)(work, *of_cameras))


@contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra and OpenCV on one thread; OpenCV's threads wait for each other longer than they work."""
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(limits=1):
            yield
    finally:
        cv2.setNumThreads(before)
