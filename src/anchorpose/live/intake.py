"""The threads that take images from the sources and hand them to the feed and to whoever records."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from threading import Event, Lock, Thread

from anchorpose.errors import AnchorposeError
from anchorpose.live.feed import Feed
from anchorpose.live.source import LiveCamera, LiveImage, LiveSource

Taker = Callable[[LiveImage], None]


class Intake:
    """One thread per source. A source that fails ends alone; ``failed`` has a sentence on all that failed.

    cameras: of all sources, in their order; feed: their images; add and remove: who else is given every image.
    """

    def __init__(self, sources: Sequence[LiveSource]) -> None:
        self.cameras: tuple[LiveCamera, ...] = tuple(camera for source in sources for camera in source.cameras)
        self.feed = Feed(len(self.cameras))
        self.failures: list[str] = []
        self._not_kept = Counter[str]()
        self._sources, self._stop = tuple(sources), Event()
        self._takers: tuple[Taker, ...] = (self.feed.put,)
        self._threads: list[Thread] = []
        self._left, self._counting = len(self._sources), Lock()

    def start(self) -> None:
        """Begins to take images; does nothing where that has begun."""
        if self._threads:
            return
        first = 0
        for source in self._sources:
            self._threads.append(Thread(target=self._run, args=(source, first), daemon=True))
            first += len(source.cameras)
        for thread in self._threads:
            thread.start()

    @property
    def failed(self) -> tuple[str, ...]:
        """What failed so far, and how many images could not be recorded, by reason."""
        lost = (f"{count} depth images could not be recorded ({why})" for why, count in self._not_kept.items())
        return (*self.failures, *lost)

    def add(self, taker: Taker) -> None:
        """From now on ``taker`` is given every image, in the threads of the sources."""
        self._takers = (*self._takers, taker)

    def remove(self, taker: Taker) -> None:
        """``taker`` is given no more images; one may still be under way."""
        self._takers = tuple(one for one in self._takers if one != taker)

    @property
    def running(self) -> bool:
        """Whether any source still gives images."""
        return self._left > 0

    def stop(self) -> None:
        """Ends all sources and waits for them."""
        self._stop.set()
        for thread in self._threads:
            thread.join(timeout=5.0)

    def _run(self, source: LiveSource, first: int) -> None:
        try:
            for image in source.images(self._stop):
                self._hand_on(replace(image, camera=first + image.camera))
        except (AnchorposeError, OSError) as error:
            self.failures.append(f"{source.name}: {error}")
        finally:
            with self._counting:
                self._left -= 1
            if self._left == 0:
                self.feed.close()

    def _hand_on(self, image: LiveImage) -> None:
        """An image that cannot be written is lost; who refuses it, as a recorder does on a disk that is nearly full, is
        given no more. The other takers are given all."""
        for taker in self._takers:
            try:
                taker(image)
            except OSError as error:
                self._not_kept[error.strerror or str(error)] += 1
            except AnchorposeError as error:
                self.remove(taker)
                self.failures.append(str(error))
