"""Read running cameras in threads, and combine the newest image of each camera into one set."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Condition, Event, Lock, Thread
from typing import Final, Protocol

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import AnchorposeError
from anchorpose.recording.depth_image import frame_set_of_greys
from anchorpose.recording.recording import USUAL_PERIOD_S, Clock, FrameSet, Recording
from anchorpose.sources.plan import CameraPlan


@dataclass(frozen=True, slots=True, eq=False)
class LiveImage:
    """A depth image of a running camera. camera: index of the camera; number: running number of the image in its
    source, where lost images are counted, too; time_s: time on the device's clock; taken_s: when the image was taken,
    by ``time.monotonic``; grey (height, width) uint16: depth in units of the camera's ``depth_scale``, 0 = no reading.
    """

    camera: int
    number: int
    time_s: float
    taken_s: float
    grey: np.ndarray


class LiveSource(Protocol):
    """A source of live images: one or several cameras that are read together. ``LiveImage.camera`` is an index into
    ``cameras``.

    name: the source's name in messages to the user; about: a recording whose equipment, images of the empty room and
    data on the patient also apply to these cameras; None without such a recording.
    """

    name: str
    cameras: tuple[CameraPlan, ...]
    about: Recording | None

    def images(self, stop: Event) -> Iterator[LiveImage]:
        """Yield the images as they are taken, until the source ends or ``stop`` is set.

        Raises AnchorposeError with the reason if a camera has stopped answering.
        """
        ...


def about_folder(sources: Sequence[LiveSource]) -> Path | None:
    """Return the folder of the first recording that any source has as ``about``; None if no source has such a
    recording.
    """
    return next((source.about.folder for source in sources if source.about is not None), None)


# A function that is called with each image. The function returns the reason if it could not keep the image, else None.
Taker = Callable[[LiveImage], str | None]
STALL_S: Final = 5.0  # s; a camera without a usable image for this time counts as unplugged
REPORT_S: Final = 10.0  # s between two messages about the cameras


class Intake:
    """The threads that read the sources, one per source. If a source fails, only its thread ends, and ``failed`` gets a
    sentence on the failure.

    cameras: cameras of all sources, in order; feed: the buffer that gets their images; ``add`` adds a receiver of every
    image, and ``remove`` removes it.
    """

    def __init__(self, sources: Sequence[LiveSource]) -> None:
        self.cameras: tuple[CameraPlan, ...] = tuple(camera for source in sources for camera in source.cameras)
        self.feed = Feed(len(self.cameras))
        self.failures: list[str] = []
        self._not_kept = Counter[str]()
        self._sources, self._stop = tuple(sources), Event()
        self._takers: tuple[Taker, ...] = (self.feed.put,)
        self._threads: list[Thread] = []
        self._left, self._counting = len(self._sources), Lock()

    def start(self) -> None:
        """Begin to read images; do nothing if reading has begun already."""
        if self._threads:
            return
        first = np.cumsum([0, *(len(source.cameras) for source in self._sources)]).tolist()
        self._threads = [
            Thread(target=self._run, args=pair, daemon=True) for pair in zip(self._sources, first, strict=False)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def failed(self) -> tuple[str, ...]:
        """Return a sentence on each failure so far and, for each reason why images could not be recorded, a sentence
        with the number of these images.
        """
        lost = (f"{count} depth images could not be recorded ({why})" for why, count in self._not_kept.items())
        return (*self.failures, *lost)

    def add(self, taker: Taker) -> None:
        """Pass every image from now on to ``taker``, in the threads of the sources."""
        self._takers = (*self._takers, taker)

    def remove(self, taker: Taker) -> None:
        """Stop passing images to ``taker``; an image that is already being passed on may still arrive."""
        self._takers = tuple(one for one in self._takers if one != taker)

    def has(self, taker: Taker) -> bool:
        """Return whether ``taker`` still gets images."""
        return taker in self._takers

    @property
    def running(self) -> bool:
        """Return whether any source still delivers images."""
        return self._left > 0

    def stop(self) -> None:
        """End all sources, and wait at most 5 s for each thread to end."""
        self._stop.set()
        for thread in self._threads:
            thread.join(timeout=5.0)

    def _run(self, source: LiveSource, first: int) -> None:
        latest_s: dict[int, float] = {}
        try:
            for image in source.images(self._stop):
                latest_s[image.camera] = _require_forward(image, latest_s.get(image.camera, -np.inf))
                self._hand_on(replace(image, camera=first + image.camera))
        except (AnchorposeError, OSError) as error:
            self.failures.append(f"{source.name}: {error}")
        except Exception as error:  # the library of a camera may raise any error
            self.failures.append(f"{source.name}: it cannot be read on ({type(error).__name__}: {error}); begin again.")
        finally:
            with self._counting:
                self._left -= 1
            if self._left == 0:
                self.feed.close()

    def _hand_on(self, image: LiveImage) -> None:
        """Pass an image to all receivers. A receiver that cannot write an image (OSError) loses this image. A receiver
        that refuses an image (AnchorposeError), such as a recorder on a nearly full disk, gets no more images. The
        other receivers get all images.
        """
        for taker in self._takers:
            try:
                if why := taker(image):
                    self._not_kept[why] += 1
            except OSError as error:
                self._not_kept[error.strerror or str(error)] += 1
            except AnchorposeError as error:
                self.remove(taker)
                self.failures.append(str(error))


def _require_forward(image: LiveImage, latest_s: float) -> float:
    """Return the latest time on a camera's clock, including this image. latest_s: the latest time before this image.

    Raises AnchorposeError if the clock was set back by more than ``STALL_S``, since images could not be used until the
    clock reaches ``latest_s`` again.
    """
    if latest_s - image.time_s > STALL_S:
        problem = f"its clock was set back by {latest_s - image.time_s:.0f} s, so later images cannot be put in order"
        raise AnchorposeError(f"{problem}; begin again")
    return max(latest_s, image.time_s)


# number of newest images kept per camera; this is enough, since an image of a set is at most one period (time between
# images) older than its camera's newest image
KEPT: Final = 4
SILENT_S: Final = 0.5  # s; a camera that has sent no image for this time is silent: the feed does not wait for it


@dataclass(frozen=True, slots=True, eq=False)
class LiveSet:
    """A set of images, one per camera that the feed uses, taken at about the same time. reference: index, in
    ``images``, of the reference camera, whose image determines the time of the set; taken_s: when this image was taken,
    by ``time.monotonic``; skipped: number of the reference camera's unused images since the previous set.
    """

    images: tuple[LiveImage | None, ...]
    reference: int
    taken_s: float
    skipped: int = 0

    def frame_set(self, cameras: Sequence[Camera], clocks: Sequence[Clock]) -> FrameSet:
        """Return the set in the form that tracking reads, with times on the first camera's clock. Images that cannot be
        used are left out, and reported in the frame set's ``problems``.

        clocks: one per camera. The frame's number is the number of the first camera's image, or 0 if the set has no
        image of this camera.
        """
        times = [
            None if image is None else float(clock.reference_s(np.array([image.time_s]))[0])
            for image, clock in zip(self.images, clocks, strict=True)
        ]
        first, main_s = self.images[0], times[self.reference]
        if main_s is None:
            raise ValueError("a frame set must have the image of its reference camera")
        greys = [None if image is None else image.grey for image in self.images]
        return frame_set_of_greys(0 if first is None else first.number, main_s, cameras, greys, times)


class Feed:
    """A buffer: sources put images in from their threads, and the tracker takes the newest complete set.

    A camera is silent if it has sent no image for ``SILENT_S``. The reference camera is the first camera in use that is
    not silent; the time of its image is the time of the set. A set is complete when every camera in use that is not
    silent has delivered an image of the set's time or later, or when that time is longer ago than the usual interval
    between images.
    """

    def __init__(self, count: int) -> None:
        self._images = [deque[LiveImage](maxlen=KEPT) for _ in range(count)]
        self._used: Sequence[int] = range(count)
        self._changed, self._open = Condition(), True
        self._last: LiveSet | None = None

    def use(self, cameras: Sequence[int]) -> None:
        """From now on, make sets of the images of these cameras only, in this order. Before the first call, sets have
        the images of all cameras.
        """
        with self._changed:
            self._used, self._last = cameras, None

    def put(self, image: LiveImage) -> None:
        """Add an image. The images of a camera must be added in the order in which they were taken."""
        with self._changed:
            self._images[image.camera].append(image)
            self._changed.notify_all()

    def close(self) -> None:
        """End the feed: no more images follow."""
        with self._changed:
            self._open = False
            self._changed.notify_all()

    def take(self, patience_s: float) -> LiveSet | None:
        """Wait for a complete set that is newer than the set that this method returned last; return the newest such
        set.

        Return None if no more images come, or if no set is complete within ``patience_s``.
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
        """Return the indices of the cameras that have sent no image for half a second."""
        now_s = time.monotonic()
        with self._changed:
            return tuple(k for k in range(len(self._images)) if self._is_silent(k, now_s))

    @property
    def is_open(self) -> bool:
        """Return whether the feed may still get images."""
        return self._open

    @property
    def _last_s(self) -> float:
        return -np.inf if self._last is None else self._last.taken_s

    def _no_more(self) -> bool:
        used = [self._images[k] for k in self._used]
        return all(not images or images[-1].taken_s <= self._last_s for images in used)

    def _skipped(self, reference: int, main: LiveImage) -> int:
        """Return the number of unused images of the reference camera since the previous set; 0 if no previous set
        exists or if the previous set had another reference camera.
        """
        before = None if self._last is None else self._last.images[reference]
        if self._last is None or before is None or self._last.reference != reference:
            return 0
        return max(main.number - before.number - 1, 0)

    def _is_silent(self, camera: int, now_s: float) -> bool:
        images = self._images[camera]
        return not images or now_s - images[-1].taken_s > SILENT_S

    def _newest(self, now_s: float) -> LiveSet | None:
        """Return the newest complete set that ``take`` has not returned yet; None without such a set."""
        awake = [k for k in self._used if not self._is_silent(k, now_s)]
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
                    main if k == reference else _nearest(self._images[k], main.taken_s, half_s) for k in self._used
                )
                place = self._used.index(reference)
                return LiveSet(images, place, main.taken_s, self._skipped(place, main))
            # the feed waits: images of the other cameras that belong to this set may come up to half an interval later
            if age_s < half_s:
                return None
        return None

    def _period_s(self, camera: int) -> float:
        taken_s = [image.taken_s for image in self._images[camera]]
        return float(np.median(np.diff(taken_s))) if len(taken_s) > 1 else USUAL_PERIOD_S


def _nearest(images: Sequence[LiveImage], taken_s: float, within_s: float) -> LiveImage | None:
    best = min(images, key=lambda one: abs(one.taken_s - taken_s), default=None)
    return best if best is not None and abs(best.taken_s - taken_s) <= within_s + 1e-6 else None
