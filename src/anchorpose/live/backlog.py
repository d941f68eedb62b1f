"""What the cameras see while room and body are still being learnt: a few frames a second, compressed."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from threading import Event, Thread
from typing import Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.live.feed import Feed, LiveSet
from anchorpose.live.source import LiveImage
from anchorpose.recording.depth_image import decode_grey_png
from anchorpose.sources.plan import encode_grey

STEP_S: Final = 0.2  # a patient in a standing frame moves little in it
MOST_STEP_S: Final = 1.0  # after a longer one, another person may stand where the patient was
PACE: Final = 2.0  # times real time, at least, at which what waits is taken, so that it comes to an end
PATIENCE_S: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class _Packed:
    """A set whose images are empty, and their content as PNG files."""

    frame: LiveSet
    files: tuple[bytes | None, ...]


class Backlog:
    """Takes sets from the feed in a thread of its own, until it has been emptied."""

    def __init__(self, feed: Feed, cameras: Sequence[Camera]) -> None:
        self._feed, self._cameras = feed, cameras
        self._packed: deque[_Packed] = deque()
        self._last_s, self._taken_at_s = -np.inf, -np.inf  # of the set taken last: its time, and when that was
        self._done = Event()
        self._thread = Thread(target=self._collect, daemon=True)
        self._thread.start()

    def take(self) -> LiveSet | None:
        """The oldest set that waits; None, and from then on nothing more is collected, when none does.

        Where following takes longer than sets are apart, some are left out: the next one is later by twice the time
        that was spent on the one before, but by no more than ``MOST_STEP_S``.
        """
        now_s = time.monotonic()
        spent_s = now_s - self._taken_at_s if np.isfinite(self._last_s) else 0.0
        next_s = self._last_s + min(PACE * spent_s, MOST_STEP_S)
        while len(self._packed) > 1 and self._packed[0].frame.taken_s < next_s:
            self._packed.popleft()
        if not self._packed:
            self._done.set()
            self._thread.join()
        if not self._packed:
            return None
        packed = self._packed.popleft()
        self._last_s, self._taken_at_s = packed.frame.taken_s, now_s
        return self._unpack(packed)

    def drop(self) -> None:
        """Collects no more and forgets what waits."""
        self._done.set()
        self._thread.join()
        self._packed.clear()

    def _collect(self) -> None:
        last_s = -np.inf
        while not self._done.is_set() and self._feed.is_open:
            found = self._feed.take(PATIENCE_S)
            if found is not None and found.taken_s - last_s >= STEP_S:
                self._packed.append(_pack(found))
                last_s = found.taken_s

    def _unpack(self, packed: _Packed) -> LiveSet:
        images = tuple(
            image if image is None or file is None else self._with_grey(image, file)
            for image, file in zip(packed.frame.images, packed.files, strict=True)
        )
        return replace(packed.frame, images=images)

    def _with_grey(self, image: LiveImage, file: bytes) -> LiveImage | None:
        camera = self._cameras[image.camera]
        grey, _ = decode_grey_png(file, camera.width, camera.height)
        return None if grey is None else replace(image, grey=grey)


def _pack(found: LiveSet) -> _Packed:
    files = tuple(None if image is None else encode_grey(image.grey) for image in found.images)
    empty = np.zeros((0, 0), np.uint16)
    images = tuple(None if image is None else replace(image, grey=empty) for image in found.images)
    return _Packed(replace(found, images=images), files)
