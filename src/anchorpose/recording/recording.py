"""The content of a recording folder, once read and checked: patient, cameras and their clocks.

What is stated about the patient is optional, and none of it is copied into results or exports.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal, overload

import numpy as np

from anchorpose.camera import Camera
from anchorpose.recording.equipment import EquipmentModel

MissingPart = Literal[
    "arm_left",
    "arm_right",
    "forearm_left",
    "forearm_right",
    "hand_left",
    "hand_right",
    "leg_left",
    "leg_right",
    "shank_left",
    "shank_right",
    "foot_left",
    "foot_right",
]
"""A part that a body may lack, with all that hangs on it: a missing arm is missing from the shoulder on."""

CoveredPart = Literal[
    "head",
    "trunk",
    "upper_arm_left",
    "upper_arm_right",
    "forearm_left",
    "forearm_right",
    "hand_left",
    "hand_right",
    "thigh_left",
    "thigh_right",
    "shank_left",
    "shank_right",
    "foot_left",
    "foot_right",
]
"""A segment that an orthosis, brace, helmet, harness or prosthesis may cover."""

GROWN_YEARS: Final = 16.0  # from then on bodies are those of adults
FIRST_RECORDED: Final = 2010  # depth cameras for everybody appeared in that year


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """The patient. None: unknown."""

    height_m: float | None = None
    age_years: float | None = None
    birth_year: int | None = None
    sex: Literal["female", "male"] | None = None
    missing: tuple[MissingPart, ...] = ()
    covered: tuple[CoveredPart, ...] = ()

    @property
    def unmeasured(self) -> Subject:
        """Return the same without what the pictures can contradict: height, age and sex."""
        return Subject(missing=self.missing, covered=self.covered)

    @property
    def grown(self) -> bool | None:
        """Return whether the patient is an adult, None where that is unknown.

        Of a birth year alone only those who were grown when the first depth cameras appeared: the year of the recording
        is not known, and results do not depend on today's date.
        """
        if self.age_years is not None:
            return self.age_years >= GROWN_YEARS
        if self.birth_year is not None and self.birth_year + GROWN_YEARS <= FIRST_RECORDED:
            return True
        return None


UNKNOWN: Final = Subject()


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
        """Return frames per second of the reference camera, without dropped frames; 30, the usual rate, for a single
        frame."""
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


def depths_of(frames: Iterable[FrameSet], camera: int) -> list[np.ndarray]:
    """Return the depth images of one camera, without the frames that have none."""
    return [depth for frame in frames if (depth := frame.depths_m[camera]) is not None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """A camera's clock: at the reference time t it shows t + ahead_s + drift (t - at_s)."""

    ahead_s: float = 0.0
    drift: float = 0.0  # seconds per second
    at_s: float = 0.0  # the reference time at which ahead_s holds

    def reference_s(self, own_s: np.ndarray) -> np.ndarray:
        """Return the reference times at which this clock showed ``own_s``, (n,) float64."""
        return np.asarray(self.at_s + (own_s - self.at_s - self.ahead_s) / (1.0 + self.drift))

    def own_s(self, reference_s: float) -> float:
        """Return the time that this clock shows at a reference time."""
        return reference_s + self.ahead_s + self.drift * (reference_s - self.at_s)


def align_clocks(recording: Recording, clocks: Sequence[Clock]) -> Recording:
    """Return ``recording`` with the times of every camera on the reference clock; one clock per camera."""
    streams = tuple(
        replace(stream, time_s=clock.reference_s(stream.time_s))
        for stream, clock in zip(recording.streams, clocks, strict=True)
    )
    return replace(recording, streams=streams)
