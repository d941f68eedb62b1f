"""Pictures of several cameras on demand, each camera on its own clock: what is looked at before frames are paired."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from anchorpose.camera import Camera
from anchorpose.recording.picture import read_depth_picture
from anchorpose.recording.recording import Recording


class Footage(Protocol):
    """Anything that gives the pictures of several cameras one by one."""

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras, the reference first."""

    @property
    def times_s(self) -> tuple[np.ndarray, ...]:
        """One a camera: (n,) float64, strictly increasing, its own clock."""

    def read(self, camera: int, position: int) -> np.ndarray | None:
        """(height, width) float32 metres, 0 = no reading; None where the picture cannot be used."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFootage:
    """The pictures of a recording folder; a doubled picture shows another moment than its time says and is None."""

    recording: Recording
    cameras: tuple[Camera, ...]  # with the poses to use, which the recording may not have

    @property
    def times_s(self) -> tuple[np.ndarray, ...]:
        """One a camera: (n,) float64, its own clock."""
        return tuple(stream.time_s for stream in self.recording.streams)

    def read(self, camera: int, position: int) -> np.ndarray | None:
        """(height, width) float32 metres, 0 = no reading; None where the picture cannot be used."""
        stream = self.recording.streams[camera]
        if stream.doubled is not None and stream.doubled[position]:
            return None
        return read_depth_picture(stream.files[position], self.recording.cameras[camera]).depth_m
