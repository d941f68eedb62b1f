"""A recording that is played at its own pace, as if its cameras were taking it now."""

from __future__ import annotations

import time
from collections.abc import Iterator
from threading import Event
from typing import Final

import numpy as np

from anchorpose.calibration.clocks import ClockConfig, settle_clocks
from anchorpose.live.source import LiveCamera, LiveImage
from anchorpose.recording.depth_image import decode_grey_png, largest_png
from anchorpose.recording.recording import Recording
from anchorpose.recording.regular_file import Unreadable, read_bounded

LATE_S: Final = 0.25
"""An image that is late by more is left out, as a camera overwrites what nobody took."""


class Playback:
    """The images of a recording, each at its time; a damaged one is left out."""

    def __init__(self, recording: Recording) -> None:
        self.name, self.about = recording.folder.resolve().name, recording
        self.cameras = tuple(LiveCamera(camera=camera) for camera in recording.cameras)
        timed, _ = settle_clocks(recording, recording.cameras, ClockConfig())  # cameras that see the same at one time
        shown_s = [stream.time_s for stream in timed.streams]
        self._order = sorted(
            (float(when), camera, place) for camera, times in enumerate(shown_s) for place, when in enumerate(times)
        )

    def images(self, stop: Event) -> Iterator[LiveImage]:
        """See ``LiveSource``."""
        first_s, began_s = self._order[0][0], time.monotonic()
        for when, camera, place in self._order:
            due_s = began_s + when - first_s
            if stop.wait(max(due_s - time.monotonic(), 0.0)):
                return
            if time.monotonic() - due_s > LATE_S:
                continue
            grey = self._read(camera, place)
            if grey is not None:
                stream = self.about.streams[camera]
                yield LiveImage(camera, int(stream.frame[place]), float(stream.time_s[place]), due_s, grey)

    def _read(self, camera: int, place: int) -> np.ndarray | None:
        stream, seen = self.about.streams[camera], self.about.cameras[camera]
        try:
            data = read_bounded(stream.files[place], largest_png(seen.width, seen.height))
        except Unreadable:
            return None
        return decode_grey_png(data, seen.width, seen.height)[0]
