"""The frames that tracking holds at once: the one last registered, and the look-ahead."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import pairwise

from anchorpose.association.hypotheses import Matcher
from anchorpose.tracker.association import link
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.run import Run


class Window:
    """The frame last registered, then the later ones; frames are matched with each other when the tree asks for it."""

    def __init__(self, frames: Sequence[Observation], run: Run) -> None:
        self.run = run
        self.frames = deque(frames)
        self._matchers = deque[Matcher | None]([None] * (len(frames) - 1))

    def __getstate__(self) -> dict[str, object]:
        """Without matches, which are found again where they are asked for."""
        return {**self.__dict__, "_matchers": deque([None] * len(self._matchers))}

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, number: int) -> Observation:
        return self.frames[number]

    def __iter__(self) -> Iterator[Observation]:
        return iter(self.frames)

    def append(self, seen: Observation) -> None:
        """One more frame of the look-ahead."""
        self._matchers.append(None)
        self.frames.append(seen)

    def replace_next(self, seen: Observation) -> None:
        """Another observation of the frame after the last registered one."""
        self.frames[1] = seen
        for number in range(min(2, len(self._matchers))):
            self._matchers[number] = None

    def move_on(self) -> None:
        """The frame after the last registered one is registered."""
        self.frames.popleft()
        self._matchers.popleft()

    def matchers(self) -> list[Matcher]:
        """For every subset of anchors, the node of the next frame that each node of a frame matches; per pair of
        frames."""
        associate = self.run.associate or link
        found = [
            associate(now, following, self.run.config) if matcher is None else matcher
            for matcher, (now, following) in zip(self._matchers, pairwise(self.frames), strict=True)
        ]
        self._matchers = deque(found)
        return found
