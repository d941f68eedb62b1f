"""The frames that tracking holds at once: the one last registered, and the look-ahead."""

from __future__ import annotations

from collections import deque
from itertools import pairwise

from anchorpose.association.hypotheses import Matcher
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.association import link
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.run import Run


class Window:
    """The frame last registered, then the later ones, of which those are observed that were asked for.

    frames: of all of them; seen: the observations of the first ones. Frames are matched when the tree asks for it.
    """

    run: Run
    frames: deque[FrameSet]
    seen: deque[Observation]
    _matchers: deque[Matcher | None]

    def __init__(self, first: Observation, run: Run) -> None:
        self.run = run
        self.frames = deque([first.frame_set])
        self.seen = deque([first])
        self._matchers = deque()

    def __getstate__(self) -> dict[str, object]:
        """Without matches, which are found again where they are asked for."""
        return {**self.__dict__, "_matchers": deque([None] * len(self._matchers))}

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, number: int) -> Observation:
        return self.seen[number]

    def append(self, frame_set: FrameSet) -> None:
        """One more frame of the look-ahead."""
        self.frames.append(frame_set)

    def see(self, seen: Observation) -> None:
        """The observation of the first frame that has none."""
        self._matchers.append(None)
        self.seen.append(seen)

    def replace_next(self, seen: Observation) -> None:
        """Another observation of the frame after the last registered one."""
        self.seen[1] = seen
        for number in range(min(2, len(self._matchers))):
            self._matchers[number] = None

    def move_on(self) -> None:
        """The frame after the last registered one is registered."""
        for held in (self.frames, self.seen, self._matchers):
            held.popleft()

    def matchers(self) -> list[Matcher]:
        """For every subset of anchors, the node of the next frame that each node of a frame matches; per pair of
        observed frames."""
        associate = self.run.associate or link
        found = [
            associate(now, following, self.run.config) if matcher is None else matcher
            for matcher, (now, following) in zip(self._matchers, pairwise(self.seen), strict=True)
        ]
        self._matchers = deque(found)
        return found
