"""The newest depth images of all cameras as one frame: what nobody takes in time is dropped, nothing queues."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from threading import Condition
from typing import Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.live.source import LiveImage
from anchorpose.recording.depth_image import image_of_grey
from anchorpose.recording.recording import USUAL_PERIOD_S, Clock, FrameSet

KEPT: Final = 4  # images of a camera: a partner is at most one period older than the newest
SILENT_S: Final = 0.5  # a camera without images for so long is not waited for


@dataclass(frozen=True, slots=True, eq=False)
class LiveSet:
    """One image of each camera that has one, taken at about the same time; taken_s: by ``time.monotonic``; skipped:
    images of the reference camera that were not taken since the set before."""

    images: tuple[LiveImage | None, ...]
    reference: int
    taken_s: float
    skipped: int = 0

    def frame_set(self, cameras: Sequence[Camera], clocks: Sequence[Clock]) -> FrameSet:
        """As tracking reads it, times on the first camera's clock; clocks: one per camera."""
        times = [
            None if image is None else float(clock.reference_s(np.array([image.time_s]))[0])
            for image, clock in zip(self.images, clocks, strict=True)
        ]
        main, main_s = self.images[self.reference], times[self.reference]
        if main is None or main_s is None:
            raise ValueError("a set has its reference image")
        return FrameSet(
            frame=main.number,
            time_s=main_s,
            depths_m=tuple(
                None if image is None else image_of_grey(image.grey, camera).depth_m
                for image, camera in zip(self.images, cameras, strict=True)
            ),
            taken_s=tuple(times),
        )


class Feed:
    """Sources put images in from their threads; the tracker takes the newest complete set.

    A set is complete when every camera that is not silent has given an image that was taken as late, or a period has
    passed. The first camera that is not silent is the reference.
    """

    def __init__(self, count: int) -> None:
        self._images = [deque[LiveImage](maxlen=KEPT) for _ in range(count)]
        self._changed, self._open = Condition(), True
        self._last: LiveSet | None = None

    def put(self, image: LiveImage) -> None:
        """One more image of a camera, in the order in which it takes them."""
        with self._changed:
            self._images[image.camera].append(image)
            self._changed.notify_all()

    def close(self) -> None:
        """No more images come."""
        with self._changed:
            self._open = False
            self._changed.notify_all()

    def take(self, patience_s: float) -> LiveSet | None:
        """The newest complete set that is newer than the one taken before; waits for it.

        None where no more images come, or none within ``patience_s``.
        """
        until_s = time.monotonic() + patience_s
        with self._changed:
            while (found := self._newest(time.monotonic())) is None:
                left_s = until_s - time.monotonic()
                if left_s <= 0.0 or (not self._open and self._no_more()):
                    return None
                self._changed.wait(min(left_s, 0.005))
            self._last = found
        return found

    def silent(self) -> tuple[int, ...]:
        """Cameras (indices) without an image for half a second."""
        now_s = time.monotonic()
        with self._changed:
            return tuple(k for k in range(len(self._images)) if self._is_silent(k, now_s))

    @property
    def is_open(self) -> bool:
        """Whether more images may come."""
        return self._open

    @property
    def _last_s(self) -> float:
        return -np.inf if self._last is None else self._last.taken_s

    def _no_more(self) -> bool:
        return all(not images or images[-1].taken_s <= self._last_s for images in self._images)

    def _skipped(self, reference: int, main: LiveImage) -> int:
        """Images of the reference that nobody took since the set before; 0 where that had another reference."""
        before = None if self._last is None else self._last.images[reference]
        if self._last is None or before is None or self._last.reference != reference:
            return 0
        return max(main.number - before.number - 1, 0)

    def _is_silent(self, camera: int, now_s: float) -> bool:
        images = self._images[camera]
        return not images or now_s - images[-1].taken_s > SILENT_S

    def _newest(self, now_s: float) -> LiveSet | None:
        """The newest set that is complete, None where none is that was not given before."""
        awake = [k for k in range(len(self._images)) if not self._is_silent(k, now_s)]
        if not awake:
            return None
        reference = awake[0]
        candidates = [one for one in self._images[reference] if one.taken_s > self._last_s + 1e-6]
        half_s = 0.5 * self._period_s(reference)
        for main in reversed(candidates):
            age_s = now_s - main.taken_s
            if (
                age_s > 2.0 * half_s
                or not self._open
                or all(self._images[k][-1].taken_s >= main.taken_s for k in awake)
            ):
                images = tuple(
                    main if k == reference else _nearest(own, main.taken_s, half_s)
                    for k, own in enumerate(self._images)
                )
                return LiveSet(images, reference, main.taken_s, self._skipped(reference, main))
            if age_s < half_s:  # the other cameras' images are under way
                return None
        return None

    def _period_s(self, camera: int) -> float:
        taken_s = [image.taken_s for image in self._images[camera]]
        return float(np.median(np.diff(taken_s))) if len(taken_s) > 1 else USUAL_PERIOD_S


def _nearest(images: Sequence[LiveImage], taken_s: float, within_s: float) -> LiveImage | None:
    best = min(images, key=lambda one: abs(one.taken_s - taken_s), default=None)
    return best if best is not None and abs(best.taken_s - taken_s) <= within_s + 1e-6 else None
