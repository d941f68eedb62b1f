"""What gives depth images while they are taken: cameras, or a recording that is played at its own pace."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Any, Protocol

import numpy as np

from anchorpose.camera import Camera
from anchorpose.recording.recording import Recording
from anchorpose.recording.recording_file import camera_document


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LiveCamera:
    """A camera that gives depth images now; model and serial: empty where not known."""

    camera: Camera
    model: str = ""
    serial: str = ""

    def document(self) -> dict[str, Any]:
        """As recording.json has it."""
        known = {key: value for key, value in (("model", self.model), ("serial", self.serial)) if value}
        return {**camera_document(self.camera), **known}


@dataclass(frozen=True, slots=True, eq=False)
class LiveImage:
    """One depth image: camera: index; number: counted by the source, with gaps where it lost images; time_s: by the
    device's own clock; taken_s: when it was taken, by ``time.monotonic``; grey (height, width) uint16, 0 = no
    reading."""

    camera: int
    number: int
    time_s: float
    taken_s: float
    grey: np.ndarray


class LiveSource(Protocol):
    """Cameras that belong together, for instance all of one maker.

    about: a recording whose equipment, empty room and patient hold for these cameras, too; None where nothing is known.
    """

    @property
    def name(self) -> str:
        """For the user."""
        ...

    @property
    def cameras(self) -> tuple[LiveCamera, ...]:
        """In the order of their indices."""
        ...

    @property
    def about(self) -> Recording | None:
        """See above."""
        ...

    def images(self, stop: Event) -> Iterator[LiveImage]:
        """The images as they are taken, until the source ends or ``stop`` is set.

        Raises AnchorposeError with what happened where a camera does not answer any more.
        """
        ...


def about_folder(sources: Sequence[LiveSource]) -> Path | None:
    """The folder of the first recording that holds for one of the sources, None where there is none."""
    return next((source.about.folder for source in sources if source.about is not None), None)
