"""What a run knows before it looks at a frame, and where its time goes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace

from anchorpose.association.hypotheses import Matcher
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.room import Room
from anchorpose.tracking.motion_database import MotionDatabase


class Stopwatch:
    """Adds up the seconds spent in each named stage; a stage inside another one is not counted twice."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self.seconds: dict[str, float] = {}
        self._clock, self._inside = clock, 0.0  # seconds of the stages inside the present one

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what runs inside."""
        before, self._inside, began = self._inside, 0.0, self._clock()
        try:
            yield
        finally:
            spent = self._clock() - began
            self.seconds[name] = self.seconds.get(name, 0.0) + spent - self._inside
            self._inside = before + spent


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What every frame of a run is tracked with.

    motions: reference movements, None where the prediction needs none. associate: how the nodes of a frame are matched
    in the next (``tracker.association.Associate``); None: ``tracker.association.link``.
    """

    room: Room
    config: TrackConfig
    motions: MotionDatabase | None = None
    stopwatch: Stopwatch = field(default_factory=Stopwatch)
    associate: Callable[..., Matcher] | None = None

    def without_patient(self, why: str) -> Run:
        """The run in which who was found is not tracked, and why."""
        return replace(self, room=replace(self.room, initial_frames=(), why_nobody=why))

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Time what runs inside as a part of the stage of this name."""
        return self.stopwatch.stage(name)
