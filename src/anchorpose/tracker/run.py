"""What a run knows before it looks at a frame, and where its time goes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field

from anchorpose.association.hypotheses import Matcher
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.room import Room
from anchorpose.tracking.motion_database import MotionDatabase


class Stopwatch:
    """Adds up the seconds spent in each named stage; stages do not nest."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what runs inside."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began


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

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Time what runs inside as a part of the stage of this name."""
        return self.stopwatch.stage(name)
