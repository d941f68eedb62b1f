"""The content of a recording folder, once read and checked, and the clocks of its cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import overload

import numpy as np

from anchorpose.camera import Camera
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.recording.subject import UNKNOWN, Subject


@dataclass(frozen=True, slots=True)
class FolderFiles(Sequence[Path]):
    """Files of one folder by their names: as paths, the 324,000 of an hour would take a fifth of a gigabyte."""

    folder: Path
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.names)

    @overload
    def __getitem__(self, place: int) -> Path: ...

    @overload
    def __getitem__(self, place: slice) -> FolderFiles: ...

    def __getitem__(self, place: int | slice) -> Path | FolderFiles:
        return (
            FolderFiles(self.folder, self.names[place]) if isinstance(place, slice) else self.folder / self.names[place]
        )


@dataclass(frozen=True, slots=True, eq=False)
class DepthStream:
    """The depth images of one camera, in the order of time."""

    files: Sequence[Path]
    time_s: np.ndarray  # (n,) float64, strictly increasing; the camera's own clock, or the reference once aligned
    frame: np.ndarray  # (n,) int64, the number in the file's name
    duplicate: np.ndarray | None = None  # (n,) bool, equal to the image before; None where this was not checked
    repeated: int = 0  # files left out because their time is that of the file before
    fps: float | None = None  # as recording.json states it
    listed: np.ndarray | None = None  # (n,) ``STAMP`` of each file when it was listed; None where this was not kept


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """A checked recording folder; depth images are read on demand, one frame at a time."""

    folder: Path
    cameras: tuple[Camera, ...]
    streams: tuple[DepthStream, ...]  # one per camera
    backgrounds_m: tuple[np.ndarray | None, ...]  # one per camera: (height, width) float32, 0 = no reading
    equipment: EquipmentModel | None
    subject: Subject = UNKNOWN  # what is stated about the patient
    notes: tuple[str, ...] = ()  # sentences on what of the folder is not used

    @property
    def rate_hz(self) -> float:
        """Frames per second of the reference camera, without dropped frames; 30, the usual rate, for a single frame."""
        time_s = self.streams[0].time_s
        return 1.0 / float(np.median(np.diff(time_s))) if len(time_s) > 1 else 30.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameSet:
    """The depth images of all cameras at one time of the reference clock (the first camera's)."""

    frame: int
    time_s: float
    depths_m: tuple[np.ndarray | None, ...]  # one per camera: (height, width) float32, 0 = no reading; None = none
    taken_s: tuple[float | None, ...] = ()  # one per camera: when its depth image was taken, reference clock
    problems: tuple[str, ...] = ()  # one sentence for each depth image that exists and cannot be used


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """A camera's clock: at the reference time t it shows t + ahead_s + drift (t - at_s)."""

    ahead_s: float = 0.0
    drift: float = 0.0  # seconds per second
    at_s: float = 0.0  # the reference time at which ahead_s holds

    def reference_s(self, own_s: np.ndarray) -> np.ndarray:
        """The reference times at which this clock showed ``own_s``, (n,) float64."""
        return np.asarray(self.at_s + (own_s - self.at_s - self.ahead_s) / (1.0 + self.drift))

    def own_s(self, reference_s: float) -> float:
        """The time that this clock shows at a reference time."""
        return reference_s + self.ahead_s + self.drift * (reference_s - self.at_s)


def align_clocks(recording: Recording, clocks: Sequence[Clock]) -> Recording:
    """``recording`` with the times of every camera on the reference clock; one clock per camera."""
    streams = tuple(
        replace(stream, time_s=clock.reference_s(stream.time_s))
        for stream, clock in zip(recording.streams, clocks, strict=True)
    )
    return replace(recording, streams=streams)
