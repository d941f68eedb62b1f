"""Measure how long each stage of a run takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Stopwatch:
    """A stopwatch that sums the seconds spent in each named stage; time in a nested stage is not counted twice."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self.seconds: dict[str, float] = {}
        self._clock, self._inside = clock, 0.0  # seconds of the finished stages inside the current stage

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the enclosed block."""
        before, self._inside, began = self._inside, 0.0, self._clock()
        try:
            yield
        finally:
            spent = self._clock() - began
            self.seconds[name] = self.seconds.get(name, 0.0) + spent - self._inside
            self._inside = before + spent
