"""Hold the content of a recording folder after it was read and checked: patient, cameras and their clocks.

Statements about the patient are optional, and are never copied into results or exports.

Real cameras are not synchronised, and frames drop: depth images of several cameras are paired by time.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal, overload

import numpy as np
from pydantic import ConfigDict, Field

from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.recording.document import Whole
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.settings import STRICT

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
"""A part of the body that may be missing, together with everything beyond it: without an arm, the body ends at that
shoulder.
"""

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

SHORTEST_SUBJECT_M, TALLEST_SUBJECT_M = 0.4, 2.8
OLDEST_YEARS: Final = 120.0

Height = Annotated[
    float, Field(gt=SHORTEST_SUBJECT_M, le=TALLEST_SUBJECT_M, description="the patient's height in metres")
]
Age = Annotated[float, Field(ge=0, le=OLDEST_YEARS, description="the patient's age in years")]
BirthYear = Annotated[Whole, Field(ge=1900, le=2100, description="the year the patient was born in")]

GROWN_YEARS: Final = 16.0  # years, minimum age at which a body counts as an adult's
FIRST_RECORDED: Final = 2010  # year in which the first consumer depth cameras appeared


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """The patient as recording.json describes them. None: unknown."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    height_m: Height | None = None
    age_years: Age | None = None
    birth_year: BirthYear | None = None
    sex: Literal["female", "male"] | None = None
    missing: tuple[MissingPart, ...] = ()
    covered: tuple[CoveredPart, ...] = ()

    @property
    def unmeasured(self) -> Subject:
        """Return the subject without height, age and sex, which the images can contradict."""
        return Subject(missing=self.missing, covered=self.covered)

    @property
    def grown(self) -> bool | None:
        """Return whether the patient is an adult; None if unknown.

        Without an age, the birth year decides only for people who were adults when the first depth cameras appeared:
        the year of the recording is unknown, and results must not depend on today's date.
        """
        if self.age_years is not None:
            return self.age_years >= GROWN_YEARS
        if self.birth_year is not None and self.birth_year + GROWN_YEARS <= FIRST_RECORDED:
            return True
        return None


UNKNOWN: Final = Subject()


@dataclass(frozen=True, slots=True)
class FolderFiles(Sequence[Path]):
    """Files of one folder, stored by their names: the paths of the 324,000 files of an hour would take 0.2 GB."""

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
    time_s: np.ndarray  # (n,) float64, increasing; on the camera's clock, after ``align_clocks`` on the reference clock
    frame: np.ndarray  # (n,) int64, the number in the file's name
    duplicate: np.ndarray | None = None  # (n,) bool, True: equal to the previous image; None if not checked
    repeated: int = 0  # number of files left out because their time equals that of the previous file
    fps: float | None = None  # frames per second as stated in recording.json
    listed: np.ndarray | None = None  # (n,) ``STAMP`` of each file when listed; None if not kept


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """A checked recording folder; depth images are read on demand, one frame at a time."""

    folder: Path
    cameras: tuple[Camera, ...]
    streams: tuple[DepthStream, ...]  # one stream per camera
    backgrounds_m: tuple[np.ndarray | None, ...]  # one per camera: (height, width) float32, 0 = no reading
    equipment: EquipmentModel | None
    subject: Subject = UNKNOWN  # statements about the patient
    notes: tuple[str, ...] = ()  # sentences on unused content of the folder

    @property
    def part_names(self) -> tuple[str, ...]:
        """Return the names of the equipment's parts; empty if its model is unknown."""
        return () if self.equipment is None else tuple(part.name for part in self.equipment.parts)

    @property
    def rate_hz(self) -> float:
        """Return the frame rate of the reference camera as if no frame were dropped; 30 for a single frame."""
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
    at_s: float = 0.0  # the reference time to which ahead_s refers

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


USUAL_PERIOD_S: Final = 1.0 / 30.0
"""Usual time in s between frames of a depth camera: assumed if the first camera has a single frame."""


@lru_cache(maxsize=8)  # called for every frame
def pair_frames(recording: Recording) -> np.ndarray:
    """Return, for each frame of the first camera, the index of the paired frame of each camera, (n, cameras) int64,
    read only; -1 = none.

    Paired frames are mutually nearest in time, within half a period of the first camera, so no depth image is used
    twice. A duplicate is never paired, since it shows another moment than its time states; a duplicate of the first
    camera leaves a frame set without that camera's depth image. Raises InputError if a camera never overlaps with
    the first one.
    """
    reference, time_s = recording.streams[0], recording.streams[0].time_s
    within_s = half_period_s(time_s)
    pairs = np.stack(
        [_pair_camera(time_s, stream.time_s, stream.duplicate, within_s) for stream in recording.streams], axis=1
    )
    if reference.duplicate is not None:
        pairs[reference.duplicate, 0] = -1
    for camera, stream, pair in zip(recording.cameras, recording.streams, pairs.T, strict=True):
        if (pair < 0).all():
            spans = f"{_span(stream.time_s)}, {_span(time_s)}"
            problem = f"camera {camera.name} never overlaps in time with camera {recording.cameras[0].name} ({spans})"
            remedy = "check that both belong to one recording and correct their time stamps"
            timestamps = recording.folder / camera.name / "timestamps.csv"
            path = timestamps if timestamps.exists() else recording.folder / "recording.json"
            raise InputError(path, problem, remedy)
    pairs.setflags(write=False)
    return pairs


def _pair_camera(
    reference_s: np.ndarray, other_s: np.ndarray, duplicate: np.ndarray | None, within_s: float
) -> np.ndarray:
    usable = np.flatnonzero(~duplicate) if duplicate is not None else np.arange(len(other_s))
    match = nearest_within(reference_s, other_s[usable], within_s)
    return np.where(match >= 0, usable[match], -1)


def half_period_s(time_s: np.ndarray) -> float:
    """Return half of the median interval between frames (n,); for a single frame, half of a usual depth camera's
    interval.
    """
    return float(np.median(np.diff(time_s)) if len(time_s) > 1 else USUAL_PERIOD_S) / 2.0


def nearest_within(time_s: np.ndarray, other_s: np.ndarray, within_s: float | np.ndarray) -> np.ndarray:
    """Return the index (n,) int64 into ``other_s`` (m,) of the mutually nearest time; -1 where none lies within
    ``within_s``, a number or (n,).
    """
    there, back = _nearest(time_s, other_s), _nearest(other_s, time_s)
    mutual = back[there] == np.arange(len(time_s))
    # plus 1 ns: times with six decimals must not be excluded by rounding at exactly half a period
    close = np.abs(other_s[there] - time_s) <= within_s + 1e-9
    return np.where(mutual & close, there, -1)


def _nearest(time_s: np.ndarray, other_s: np.ndarray) -> np.ndarray:
    after = np.clip(np.searchsorted(other_s, time_s), 1, len(other_s) - 1) if len(other_s) > 1 else None
    if after is None:
        return np.zeros(len(time_s), dtype=np.int64)
    earlier = time_s - other_s[after - 1] <= other_s[after] - time_s
    return (after - earlier).astype(np.int64)


def _span(time_s: np.ndarray) -> str:
    return f"{time_s[0]:.3f} to {time_s[-1]:.3f} s"


USUAL_RATES_HZ: Final = (5.0, 6.0, 15.0, 25.0, 30.0, 60.0, 90.0)
"""Usual frame rates of depth cameras."""

# quantile of the steps that is several periods long if frames are lost, even if only every third frame is lost
LONGER_SHARE: Final = 0.6
# maximum period that is tried, as a share of that step; the true period is at most 0.5 of it, and 30 Hz is 0.83 of 25
# Hz
SHORTER: Final = 0.75
# minimum share of the steps that must be one period; a smaller share are time stamps that come too early
LEAST_SHORT: Final = 0.1
OFF_BEAT: Final = 0.25  # periods; if a step differs by more from a whole number of periods, it is off the beat
LEAST_ON_BEAT: Final = 0.8  # minimum share of the steps that must be whole numbers of periods


def nominal_period_s(stream: DepthStream) -> float:
    """Return the time between frames when none is lost, as stated in recording.json. Otherwise it is the median step.
    But if some steps are one period of a usual rate and all other steps are several periods, it is that period. The
    result is 0 for a single frame without a stated rate.

    Frames lost in a regular pattern change the median. A recording that lost every second frame has even steps: only
    recording.json can distinguish it from half the rate.
    """
    steps = np.diff(stream.time_s)
    if stream.fps is not None or not len(steps):
        return 0.0 if stream.fps is None else 1.0 / stream.fps
    median_s = float(np.median(steps))
    longest_s = SHORTER * float(np.quantile(steps, LONGER_SHARE))
    for period_s in (1.0 / hz for hz in USUAL_RATES_HZ if 1.0 / hz < longest_s):
        on_beat = off_beat(steps, period_s) <= OFF_BEAT
        single = on_beat & (np.rint(steps / period_s) <= 1.0)
        if on_beat.mean() >= LEAST_ON_BEAT and single.mean() >= LEAST_SHORT:
            return period_s
    return median_s


def off_beat(steps_s: np.ndarray, period_s: float) -> np.ndarray:
    """Return (n,): the distance of each step from the nearest whole number of periods, in periods."""
    beats = steps_s / period_s
    return np.asarray(np.abs(beats - np.maximum(np.rint(beats), 1.0)))


PAUSE_S: Final = 1.0
"""Maximum time in s without depth images that counts as dropped frames; a longer time is a pause."""


@dataclass(frozen=True, slots=True)
class CameraGaps:
    """The gaps of one camera's stream, on the reference clock.

    usable: number of depth images; period_s: ``nominal_period_s``; dropped: number of images missing between its first
    and last, by this period and without pauses; duplicates, repeated: numbers of files left out because their image or
    their time equals that of the previous file; late_s, early_s: by how much it starts later, or ends earlier, than the
    first camera, else 0; pauses: (from, to) without depth images; paired_share: share of the first camera's frames that
    have a depth image of this camera.
    """

    camera: str
    usable: int
    period_s: float
    dropped: int
    duplicates: int
    repeated: int
    late_s: float
    early_s: float
    pauses: tuple[tuple[float, float], ...]
    paired_share: float

    @property
    def sentence(self) -> str:
        """Return a sentence on missing images; empty if none is missing."""
        parts = []
        if self.dropped:
            parts.append(f"{self.dropped} of {self.usable + self.dropped} depth images are missing")
        if self.duplicates:
            parts.append(f"{self.duplicates} equal the previous depth image and were left out")
        if self.repeated:
            parts.append(f"{self.repeated} have the time of the previous one and were left out")
        if self.late_s:
            parts.append(f"it starts {self.late_s:.1f} s late")
        if self.early_s:
            parts.append(f"it ends {self.early_s:.1f} s early")
        parts += [f"it has no depth images from {begin_s:.1f} to {end_s:.1f} s" for begin_s, end_s in self.pauses]
        return f"camera {self.camera}: {'; '.join(parts)}" if parts else ""


def find_gaps(recording: Recording) -> tuple[CameraGaps, ...]:
    """Return each camera's gaps; the times of ``recording`` are on the reference clock (see ``align_clocks``)."""
    pairs, reference_s = pair_frames(recording), recording.streams[0].time_s
    return tuple(_of_camera(recording, index, pairs[:, index], reference_s) for index in range(len(recording.cameras)))


def _of_camera(recording: Recording, index: int, pair: np.ndarray, reference_s: np.ndarray) -> CameraGaps:
    stream = recording.streams[index]
    time_s = stream.time_s
    steps = np.diff(time_s)
    period_s = nominal_period_s(stream)
    paused = steps > max(PAUSE_S, 3.0 * period_s)
    missing = np.rint(steps / period_s) - 1.0 if len(steps) else np.zeros(0)
    duplicates = 0 if stream.duplicate is None else int(stream.duplicate.sum())
    late_s, early_s = float(time_s[0] - reference_s[0]), float(reference_s[-1] - time_s[-1])
    return CameraGaps(
        camera=recording.cameras[index].name,
        usable=len(time_s) - duplicates,
        period_s=period_s,
        dropped=int(np.maximum(missing, 0.0)[~paused].sum()),
        duplicates=duplicates,
        repeated=stream.repeated,
        late_s=late_s if late_s > PAUSE_S else 0.0,
        early_s=early_s if early_s > PAUSE_S else 0.0,
        pauses=tuple((float(time_s[k]), float(time_s[k + 1])) for k in np.flatnonzero(paused)),
        paired_share=float((pair >= 0).mean()),
    )
