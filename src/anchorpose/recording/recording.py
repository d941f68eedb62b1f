"""Hold the content of a recording folder after it was read and checked: patient, cameras and their clocks.

Statements about the patient, such as height or age, are optional; they are never copied into results or exports.

Real cameras are not synchronised and lose some frames, so the depth images of several cameras are paired by time.
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
"""A part of the body that the patient may lack. Everything beyond this part is missing too: without ``arm_left``, the
body ends at the left shoulder.
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
"""A segment of the body that an orthosis, brace, helmet, harness or prosthesis may cover."""

SHORTEST_SUBJECT_M, TALLEST_SUBJECT_M = 0.4, 2.8
OLDEST_YEARS: Final = 120.0

Height = Annotated[
    float, Field(gt=SHORTEST_SUBJECT_M, le=TALLEST_SUBJECT_M, description="the patient's height in metres")
]
Age = Annotated[float, Field(ge=0, le=OLDEST_YEARS, description="the patient's age in years")]
BirthYear = Annotated[Whole, Field(ge=1900, le=2100, description="the year the patient was born in")]

GROWN_YEARS: Final = 16.0  # years, minimum age at which a body counts as an adult's
FIRST_RECORDED: Final = 2010  # year of the first consumer depth cameras; no recording is older


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """The patient as recording.json describes them; a field is None if recording.json does not state it.

    missing: parts of the body that the patient lacks; covered: segments covered by an orthosis or another device.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    height_m: Height | None = None
    age_years: Age | None = None
    birth_year: BirthYear | None = None
    sex: Literal["female", "male"] | None = None
    missing: tuple[MissingPart, ...] = ()
    covered: tuple[CoveredPart, ...] = ()

    @property
    def unmeasured(self) -> Subject:
        """Return the patient without the statements that depth images can contradict: height, age and sex."""
        return Subject(missing=self.missing, covered=self.covered)

    @property
    def grown(self) -> bool | None:
        """Return whether the patient is an adult; None if unknown.

        If only the birth year is given, the result is True for people who were adults when the first depth cameras
        appeared (``FIRST_RECORDED``), and None for younger people: the year of the recording is unknown, and results
        must not depend on today's date.
        """
        if self.age_years is not None:
            return self.age_years >= GROWN_YEARS
        if self.birth_year is not None and self.birth_year + GROWN_YEARS <= FIRST_RECORDED:
            return True
        return None


UNKNOWN: Final = Subject()


@dataclass(frozen=True, slots=True)
class FolderFiles(Sequence[Path]):
    """A sequence of paths in one folder that stores only the file names, since 324,000 whole paths (an hour of three
    cameras) would take 0.2 GB of memory.
    """

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
    """The depth images of one camera in chronological order."""

    files: Sequence[Path]
    time_s: np.ndarray  # (n,) float64, increasing; on the camera's clock, or the reference clock after ``align_clocks``
    frame: np.ndarray  # (n,) int64, the number in the file's name
    duplicate: np.ndarray | None = None  # (n,) bool, True: equals the previous image; None if not checked
    repeated: int = 0  # number of files left out because their time equals that of the previous file
    fps: float | None = None  # frames per second as stated in recording.json
    listed: np.ndarray | None = None  # (n,) size, time, inode of each file when the recording was opened; or None


LEFT_OUT: Final = "was left out: "
"""Part of each note on a camera that was left out, before the reason; ``check`` reports these notes by themselves."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """A recording folder that was checked; its depth images are read on demand, one frame at a time."""

    folder: Path
    cameras: tuple[Camera, ...]
    streams: tuple[DepthStream, ...]  # one stream per camera
    # depth image of the empty room, one per camera: (height, width) float32 metres, 0 = no reading; None if not
    # recorded
    backgrounds_m: tuple[np.ndarray | None, ...]
    equipment: EquipmentModel | None
    subject: Subject = UNKNOWN  # statements about the patient
    # sentences on content that is not used, and sentences that the recorder or converter wrote
    notes: tuple[str, ...] = ()
    # first and last recorded time of the first camera in recording.json if this camera was left out, else None
    left_out_s: tuple[float, float] | None = None

    @property
    def part_names(self) -> tuple[str, ...]:
        """Return the names of the equipment's parts; empty if its model is unknown."""
        return () if self.equipment is None else tuple(part.name for part in self.equipment.parts)

    @property
    def rate_hz(self) -> float:
        """Return the frame rate of the first camera, from the median interval; 30 if the camera has a single frame."""
        time_s = self.streams[0].time_s
        return 1.0 / float(np.median(np.diff(time_s))) if len(time_s) > 1 else 30.0

    def of_cameras(self, places: Sequence[int]) -> Recording:
        """Return the recording with only the cameras at these indices, in the order of ``places``."""
        return replace(
            self,
            cameras=tuple(self.cameras[place] for place in places),
            streams=tuple(self.streams[place] for place in places),
            backgrounds_m=tuple(self.backgrounds_m[place] for place in places),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameSet:
    """The depth images of all cameras at one time of the reference clock (the first camera's)."""

    frame: int  # number of the first camera's image
    time_s: float
    depths_m: tuple[np.ndarray | None, ...]  # one per camera: (height, width) float32, 0 = no reading; None = no image
    taken_s: tuple[float | None, ...] = ()  # one per camera: time of its depth image on the reference clock
    problems: tuple[str, ...] = ()  # one sentence for each depth image that exists and cannot be used
    # position in the first camera's stream, or among the tracked frames of a live session; None if unknown
    position: int | None = None


def depths_of(frames: Iterable[FrameSet], camera: int) -> list[np.ndarray]:
    """Return the depth images of one camera; frames without an image of this camera are left out."""
    return [depth for frame in frames if (depth := frame.depths_m[camera]) is not None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """A camera's clock. At the time t of the reference clock, this clock shows t + ahead_s + drift * (t - at_s)."""

    ahead_s: float = 0.0
    drift: float = 0.0  # seconds per second
    at_s: float = 0.0  # the reference time to which ahead_s refers

    def reference_s(self, own_s: np.ndarray) -> np.ndarray:
        """Return the reference times at which this clock showed ``own_s``, (n,) float64."""
        return np.asarray(self.at_s + (own_s - self.at_s - self.ahead_s) / (1.0 + self.drift))


def align_clocks(recording: Recording, clocks: Sequence[Clock]) -> Recording:
    """Return ``recording`` with the times of every camera on the reference clock. clocks: one per camera."""
    streams = tuple(
        replace(stream, time_s=clock.reference_s(stream.time_s))
        for stream, clock in zip(recording.streams, clocks, strict=True)
    )
    return replace(recording, streams=streams)


USUAL_PERIOD_S: Final = 1.0 / 30.0
"""Usual time in s between frames of a depth camera: assumed if the first camera has a single frame."""


@lru_cache(maxsize=8)  # cached, since it is called for every frame
def pair_frames(recording: Recording) -> np.ndarray:
    """Return (n, cameras) int64, read only: for each image of the first camera, the position of the paired image in
    each camera's stream; -1 = none.

    Paired images are mutually nearest in time, within half a period of the first camera, so no image is used twice. A
    duplicate of the previous image is never paired, since it shows another moment than its time states; if the first
    camera's image is such a duplicate, the frame set has no image of the first camera. Raises InputError if no image of
    a camera can be paired.
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
    """Return half of the median interval between times (n,); for a single time, half of a usual depth camera's
    interval.
    """
    return float(np.median(np.diff(time_s)) if len(time_s) > 1 else USUAL_PERIOD_S) / 2.0


def nearest_within(time_s: np.ndarray, other_s: np.ndarray, within_s: float | np.ndarray) -> np.ndarray:
    """Return (n,) int64: for each time of ``time_s`` (n,), the index into ``other_s`` (m,) of the mutually nearest
    time. The index is -1 if no time lies within ``within_s``, a number or (n,).
    """
    there, back = _nearest(time_s, other_s), _nearest(other_s, time_s)
    mutual = back[there] == np.arange(len(time_s))
    # 1 ns is added, so that rounding does not exclude a time that is exactly half a period away
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

# quantile of the steps (the times between successive frames) with which the possible frame periods are compared. If
# every third or every second frame is lost, the step (time between frames) at the quantile 0.6 is several frame periods
# long
LONGER_SHARE: Final = 0.6
# maximum period that is tried, as a share of the step at ``LONGER_SHARE``. If the step at ``LONGER_SHARE`` is several
# periods long, one period is at most half of this step. If ``SHORTER`` were above 0.83 (25 / 30), the period of 30 Hz
# would also be tried for a recording at 25 Hz without lost frames.
SHORTER: Final = 0.75
# minimum share of the steps that must be one period long; a smaller share may be due to a few early time stamps
LEAST_SHORT: Final = 0.1
OFF_BEAT: Final = 0.25  # periods, maximum difference of a step from a whole number of periods
LEAST_ON_BEAT: Final = 0.8  # minimum share of the steps that must be whole numbers of periods within ``OFF_BEAT``


def nominal_period_s(stream: DepthStream) -> float:
    """Return the time in s between frames if no frame is lost; 0 for a single frame without a stated rate.

    The period follows from the rate in recording.json, if stated. Otherwise it is the period of a usual rate, if enough
    steps between frames are one such period and most other steps are several periods. (The median step would be wrong
    if frames are lost in a regular pattern.) If no usual rate fits, the period is the median step. If every second
    frame was lost, all steps are equal; only recording.json can distinguish such a recording from a recording at half
    the rate.
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
"""Maximum time in s without depth images that counts as dropped frames; a longer time counts as a pause."""


@dataclass(frozen=True, slots=True)
class CameraGaps:
    """The gaps of one camera's stream, on the reference clock.

    usable: number of depth images; period_s: ``nominal_period_s``; dropped: number of images missing between the first
    and the last, except in pauses, if the camera takes an image every ``period_s``; duplicates, repeated: numbers of
    files left out because their image or their time equals that of the previous file; late_s, early_s: by how much the
    stream starts later, or ends earlier, than the first camera's stream, 0 if by at most ``PAUSE_S``; pauses: (from,
    to) in s without depth images; paired_share: share of the first camera's frames that have a depth image of this
    camera.
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
        """Return a sentence on missing images; empty if no image is missing."""
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
    """Return each camera's gaps. The times of ``recording`` must be on the reference clock (see ``align_clocks``)."""
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
