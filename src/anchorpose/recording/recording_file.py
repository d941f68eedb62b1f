"""Read recording.json (format ``rgbd-recording``), timestamps.csv, and two inputs that may replace parts of the
recording: calibration.json and a given height of the patient. Find duplicate depth images.

Some recorders write an image twice, with two different times: the second copy then shows an earlier moment than its
time states.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.lens import COEFFICIENTS, NAMES, Intrinsics, LensModel
from anchorpose.options import FARTHEST_M
from anchorpose.recording.document import (
    Entry,
    FileInFolder,
    Text,
    Version,
    Whole,
    numbers,
    plain_values,
    read_document,
    read_rows,
    require_file_name,
    require_rigid,
)
from anchorpose.recording.recording import USUAL_PERIOD_S, Recording, Subject
from anchorpose.recording.regular_file import Unreadable, read_bounded
from anchorpose.settings import LARGEST, Unfit, shown

MOST_REPEATED: Final = 0.1
"""Maximum share of a camera's times that may equal the previous time; with more equal times, its clock is too
coarse."""

SHORTEST_STEP_S: Final = 1e-4
"""Time in s within which no camera takes two depth images; times that differ by less count as equal."""

LONGEST_STEP_S: Final = 5.0
"""Maximum median step between images in s. No person can be followed over longer steps, so the unit of such times is
probably wrong.
"""

FARTHEST_TIME_S: Final = 1e11
"""Maximum time in s; seconds since any epoch in use are at most a fifth of this value."""

Seconds = Annotated[float, Field(ge=-FARTHEST_TIME_S, le=FARTHEST_TIME_S, description="a time in seconds")]

_UNITS: Final = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}  # number of each unit in a second


def read_timestamps(path: Path) -> dict[int, float]:
    """Read the time in seconds of each frame number from timestamps.csv, in the order of the file.

    Recorders sometimes give a frame the time of the previous frame. A repeated time is returned, too; the caller leaves
    out the depth image with this time. Raises InputError if frame numbers do not increase, if times decrease, or if so
    many times repeat that the clock is too coarse.
    """
    times: dict[int, float] = {}
    last_frame, last_time = -1, -math.inf
    repeated = list[str]()
    (_, head), *rows = read_rows(path) or [(1, [""])]
    if head != ["frame", "time_s"]:
        raise InputError(path, f"starts with {','.join(head)[:60]!r}", "its first line must be frame,time_s")
    for line, cells in rows:
        frame, time_s = _parse_row(path, line, cells)
        if frame <= last_frame:
            raise InputError(path, f"line {line}: frame {frame} does not come after {last_frame}", "sort the rows")
        later = "later" if time_s <= last_time else f"{1e3 * SHORTEST_STEP_S:g} ms later"
        problem = f"line {line}: time {time_s:.15g} s of frame {frame} is not {later} than {last_time:.15g} s"
        if time_s < last_time:
            raise InputError(
                path, problem, "times must increase: sort the rows, or correct the clock that was set back"
            )
        if time_s - last_time <= SHORTEST_STEP_S:
            repeated.append(problem)
        times[frame] = time_s
        last_frame, last_time = frame, time_s
    if not times:
        raise InputError(path, "lists no frame", "add one row per depth image or remove the recording")
    if len(repeated) > MOST_REPEATED * len(times):
        remedy = "write times with more decimals, or remove the depth images that were stored twice"
        raise InputError(path, f"{repeated[0]}, and so for {len(repeated)} of {len(times)} frames", remedy)
    require_seconds(path, np.array(list(times.values())))
    return times


def require_seconds(path: Path, time_s: np.ndarray) -> None:
    """Raise InputError if the times (n,) of images are so far apart or so large that they cannot be seconds."""
    with np.errstate(over="ignore"):
        step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    if step > LONGEST_STEP_S:
        problem = f"has times that are {step:.6g} s apart"
        unit = min(_UNITS, key=lambda name: abs(np.log(step / _UNITS[name] / USUAL_PERIOD_S)))
        if SHORTEST_STEP_S < step / _UNITS[unit] <= LONGEST_STEP_S:
            problem += f", as if they were {unit}"
            raise InputError(path, problem, f"write seconds: divide the times by {_UNITS[unit]:,.0f}")
        raise InputError(path, problem, "write when each image was taken, in seconds")
    if np.abs(time_s).max() > FARTHEST_TIME_S:
        problem = f"has the time {time_s[np.abs(time_s).argmax()]:.6g} s"
        raise InputError(path, problem, "write seconds, from the start of the recording or since 1970")


def _parse_row(path: Path, line: int, cells: list[str]) -> tuple[int, float]:
    try:
        frame, time_s = int(cells[0]), float(cells[1])
        if len(cells) == 2 and frame >= 0 and math.isfinite(time_s):
            return frame, time_s
    except (ValueError, IndexError):
        pass
    problem = f"line {line} is {','.join(cells)[:60]!r}, not a frame number and a time"
    raise InputError(path, problem, "write for example 12,0.400")


MOST_DUPLICATES: Final = 0.5
"""Maximum share of images that may equal the previous image. With more, the images have no noise, so equal images need
not be copies.
"""


def find_duplicates(files: Sequence[Path], sizes: Sequence[int], most_bytes: int) -> np.ndarray:
    """Return (n,) bool: files that are byte for byte equal to the previous file. files: regular files; sizes: the
    files' sizes in bytes.

    Two images of the same scene differ by the sensor's noise, so equal files are copies of the same image. Files of
    different sizes are not opened. Files above ``most_bytes`` are not opened either, since they are larger than any
    depth image. If most files are equal, the result is all False: the images then have no noise, so equal files need
    not be copies.
    """
    duplicate = np.zeros(len(files), dtype=bool)
    for k in range(1, len(files)):
        duplicate[k] = 0 < sizes[k] == sizes[k - 1] <= most_bytes and _same(files[k - 1], files[k], sizes[k])
    return duplicate if duplicate.sum() <= MOST_DUPLICATES * len(files) else np.zeros(len(files), dtype=bool)


def _same(one: Path, other: Path, size: int) -> bool:
    try:
        return read_bounded(one, size) == read_bounded(other, size)
    except Unreadable:
        return False  # the reason why the file is unreadable is reported when its image is read


FARTHEST_CAMERA_M: Final = FARTHEST_M
"""Maximum absolute value in m of a coordinate of a camera or joint. Cameras and joints are in the room, so a larger
value was probably written in mm.
"""

COARSEST_DEPTH_SCALE_M: Final = 0.1
"""Maximum accepted metres per grey value. A step of 10 cm resolves no limb, so a larger scale means a wrong unit."""

FOCAL_PX: Final = (1.0, 1e5)
"""Minimum and maximum focal length in pixels. With 1 pixel, the whole field of view would fall into one pixel; with a
hundred thousand, an image of 640 pixels would show only 13 cm of a surface at 20 m.
"""

FARTHEST_PRINCIPAL_PX: Final = 1e5  # maximum size of a coordinate of the principal point
# maximum size of a lens coefficient; the coefficients of the rational model nearly cancel each other, and reach some
# hundreds
LARGEST_COEFFICIENT: Final = 1e4
MOST_PIXELS: Final = 1 << 23
"""Maximum number of pixels of an image: the largest depth cameras have five million."""

LARGEST_SIDE_PX: Final = 16384  # maximum width and height of an image
MOST_CAMERAS: Final = 16
# minimum valid radius of a lens, as sqrt(x² + y²) / z of a ray; this value is half a degree from the optical axis
NARROWEST_LENS: Final = 0.01
FINEST_DEPTH_SCALE_M: Final = 1e-6  # minimum metres per grey value; with it, the largest 16-bit value is 6.6 cm
SLOWEST_HZ: Final = 0.1  # minimum frame rate in Hz; with fewer images, no person can be tracked

SAME_HEIGHT_M: Final = 0.03  # m, maximum difference of two stated heights that shoes or the time of day explain


def _require_in_room(pose: np.ndarray) -> np.ndarray:
    farthest_m = np.abs(require_rigid(pose, ", or null to have it estimated")[:3, 3]).max()
    if farthest_m > FARTHEST_CAMERA_M:
        raise Unfit(f"puts the camera {farthest_m:.0f} m away", "write the translation in metres")
    return pose


def _require_folder_name(name: str) -> str:
    if not re.fullmatch(r"[\w][\w .+-]*", name) or name.endswith((".", " ")):
        raise Unfit(f"is {shown(name)}", "it names a folder: use letters, digits, - and _")
    return require_file_name(name)


Focal = Annotated[float, Field(ge=FOCAL_PX[0], le=FOCAL_PX[1], description="the focal length in pixels")]
Principal = Annotated[
    float, Field(ge=-FARTHEST_PRINCIPAL_PX, le=FARTHEST_PRINCIPAL_PX, description="the principal point in pixels")
]
Coefficient = Annotated[float, Field(ge=-LARGEST_COEFFICIENT, le=LARGEST_COEFFICIENT)]
Distortion = Annotated[tuple[Coefficient, ...], Field(description="the coefficients of the lens, in OpenCV's order")]
Radius = Annotated[
    float, Field(ge=NARROWEST_LENS, le=LARGEST, description="the radius within which the lens is valid, in units of z")
]
Size = Annotated[Whole, Field(gt=0, le=LARGEST_SIDE_PX, description="the size of the depth images in pixels")]
Rate = Annotated[float, Field(ge=SLOWEST_HZ, le=1000, description="depth images per second")]
CameraPose = Annotated[
    np.ndarray,
    numbers(4, 4, meaning="four rows of four numbers, or null where the pose is unknown"),
    AfterValidator(_require_in_room),
]


class LensEntry(Entry):
    """The intrinsics of a camera in recording.json. Without ``distortion``, its depth images are undistorted already;
    without ``model``, the distortion has the five coefficients of Brown and Conrady.
    """

    fx: Focal
    fy: Focal
    cx: Principal
    cy: Principal
    model: LensModel = LensModel.BROWN_CONRADY
    distortion: Distortion | None = None
    valid_radius: Radius | None = None

    def lens(self) -> Intrinsics:
        """Return the lens that the entry describes."""
        return Intrinsics(**self.model_dump(exclude_none=True))

    @model_validator(mode="after")
    def _require_all_coefficients(self) -> LensEntry:
        counts = COEFFICIENTS[self.model]
        if self.distortion is not None and len(self.distortion) not in counts:
            wanted = " or ".join(map(str, counts))
            problem = f"has {len(self.distortion)} numbers, and a {self.model.value} lens has {wanted}"
            other = [model for model, allowed in COEFFICIENTS.items() if len(self.distortion) in allowed]
            remedy = f'write "model": "{other[0].value}" beside it' if other else f"write {NAMES[self.model]}"
            raise Unfit(problem, remedy, "distortion")
        return self


class CameraEntry(Entry):
    """The description of a camera in recording.json. ``camera_to_world`` is None if unknown, ``fps`` is None if
    timestamps.csv gives the times; ``model`` and ``serial`` (number) of the device are None if not recorded.
    """

    name: Annotated[str, AfterValidator(_require_folder_name)]
    width: Size
    height: Size
    depth_scale: Annotated[
        float,
        Field(
            ge=FINEST_DEPTH_SCALE_M,
            le=COARSEST_DEPTH_SCALE_M,
            description="metres per grey value (0.001 for millimetres)",
        ),
    ]
    intrinsics: LensEntry
    camera_to_world: CameraPose | None = None
    fps: Rate | None = None
    model: Text | None = None
    serial: Text | None = None

    @model_validator(mode="after")
    def _require_depth_camera(self) -> CameraEntry:
        if self.width * self.height > MOST_PIXELS:
            problem = f"are {self.width} x {self.height} pixels"
            raise Unfit(problem, "give the size of the depth images, not of colour images", "width and height")
        return self

    def camera(self) -> Camera:
        """Return the camera that the entry describes."""
        same = self.model_dump(include={"name", "width", "height", "depth_scale"})
        return Camera(**same, intrinsics=self.intrinsics.lens(), T_world_camera=self.camera_to_world)


def _require_utc(text: str) -> str:
    try:
        is_utc = text.isascii() and datetime.fromisoformat(text).utcoffset() == timedelta(0)
    except ValueError:
        is_utc = False
    if not is_utc:
        raise Unfit(f"is {shown(text)}", "write the time in UTC, for example 2026-03-28T09:15:02.125Z")
    return text


class StartEntry(Entry):
    """The time at which the first depth image of the first camera was taken, on clocks shared with other devices.

    utc: time as ISO 8601 in UTC. lsl_s: time by the clock of the Lab Streaming Layer on the computer that recorded.
    """

    utc: Annotated[Text, AfterValidator(_require_utc)] | None = None
    lsl_s: Seconds | None = None


class RecordingDocument(Entry):
    """The content of recording.json, before any other file of the folder is read.

    ``fps`` here is the frame rate of all cameras whose entries have none. ``notes``: sentences of the program that made
    the recording, for instance on a camera that it left out.
    """

    format: Literal["rgbd-recording"]
    version: Version
    cameras: tuple[CameraEntry, ...]
    equipment: FileInFolder | None = None
    subject: Subject | None = None
    fps: Rate | None = None
    start: StartEntry | None = None
    notes: tuple[Text, ...] = ()

    @model_validator(mode="after")
    def _require_named_cameras(self) -> RecordingDocument:
        if not self.cameras:
            raise Unfit("is empty", "list at least one camera", "cameras")
        if len(self.cameras) > MOST_CAMERAS:
            raise Unfit(f"has {len(self.cameras)} cameras", f"list {MOST_CAMERAS} at most", "cameras")
        # a camera's name is also the name of its folder, and some file systems do not distinguish upper and lower case
        folded = [camera.name.casefold() for camera in self.cameras]
        for camera in self.cameras:
            if folded.count(camera.name.casefold()) > 1:
                raise Unfit(f"has two cameras named '{camera.name}'", "give each camera its own name", "cameras")
        return self


def camera_document(camera: Camera) -> dict[str, Any]:
    """Return a camera in the form of recording.json."""
    lens = camera.intrinsics
    document: dict[str, Any] = plain_values(
        {
            "name": camera.name,
            "width": camera.width,
            "height": camera.height,
            "depth_scale": camera.depth_scale,
            "intrinsics": {
                "fx": lens.fx,
                "fy": lens.fy,
                "cx": lens.cx,
                "cy": lens.cy,
                **({} if lens.model is LensModel.BROWN_CONRADY else {"model": lens.model.value}),
                "distortion": lens.distortion,
                **({} if lens.valid_radius is None else {"valid_radius": lens.valid_radius}),
            },
            "camera_to_world": camera.T_world_camera,
        }
    )
    return document


def with_height(recording: Recording, height_m: float | None) -> Recording:
    """Return the recording with the given height of the patient, or unchanged if ``height_m`` is None.

    Raises InputError if the given height contradicts the height in recording.json, since either may be wrong.
    """
    own_m = recording.subject.height_m
    if height_m is None:
        return recording
    if own_m is not None and abs(own_m - height_m) > SAME_HEIGHT_M:
        raise InputError(
            recording.folder / "recording.json",
            f"says that the patient is {own_m:.2f} m tall, and the given height is {height_m:.2f} m",
            "measure again, and correct the one or leave the other out",
        )
    return replace(recording, subject=replace(recording.subject, height_m=height_m))


CALIBRATION_FORMAT: Final = "camera-calibration"
CALIBRATION_FILE: Final = "calibration.json"
RECORDING_FILE: Final = "recording.json"


class CalibratedCamera(Entry, extra="ignore"):
    """The entry of a camera in calibration.json; only its pose is used."""

    name: Text
    camera_to_world: CameraPose


class CalibrationDocument(Entry, extra="ignore"):
    """The content of calibration.json, format ``camera-calibration``."""

    format: Literal["camera-calibration"]
    version: Version
    cameras: tuple[CalibratedCamera, ...]


def calibration_file(path: Path) -> Path:
    """Return the path of a calibration.json, given the file or its folder."""
    return path / CALIBRATION_FILE if path.is_dir() else path


def read_calibration(path: Path) -> dict[str, np.ndarray]:
    """Read T_world_camera (4, 4) by camera name from a calibration.json or its folder; raises InputError."""
    file = calibration_file(path)
    cameras = read_document(file, CalibrationDocument).cameras
    poses = {camera.name: camera.camera_to_world for camera in cameras}
    if len(poses) < len(cameras):
        counts = Counter(camera.name for camera in cameras)
        twice = next(name for name, count in counts.items() if count > 1)
        raise InputError(file, f"cameras names '{twice}' twice", "keep one of the two")
    return poses


def with_poses(recording: Recording, path: Path) -> Recording:
    """Return the recording with the poses of a calibration file instead of the recording's poses.

    Raises InputError if the file lacks the pose of a camera: the recording's poses are in another world than the
    file's, so they cannot be mixed.
    """
    poses = read_calibration(path)
    missing = [camera.name for camera in recording.cameras if camera.name not in poses]
    if missing:
        remedy = "calibrate a recording of the same cameras, or leave this file out"
        raise InputError(path, f"has no pose for camera {', '.join(missing)}", remedy)
    cameras = tuple(replace(camera, T_world_camera=poses[camera.name]) for camera in recording.cameras)
    return replace(recording, cameras=cameras)
