"""Find the reader for a recorder's file by the file's content, and define ``Source``: the opened file, which gives
cameras and depth images. A recorder is any other program or device that records depth images.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from anchorpose.errors import InputError
from anchorpose.lens import Intrinsics
from anchorpose.recording.document import LARGEST_BYTES, parse_json, read_text
from anchorpose.recording.regular_file import Unreadable, open_regular, read_bounded

MILLIMETRE_M: Final = 0.001

NO_READING: Final = 65535  # grey value that means no reading, as 0 does: the surface was too far or too near

# m, maximum movement of a camera that stands still; the estimated position of a phone on a tripod drifts by some mm
STANDS_STILL_M: Final = 0.03

MODULES: Final = (
    "azure_kinect",
    "ros_bags",
    "phones",
    "published_folders",
    "mat_file",
    "image_folder",  # tried last: folders of most other formats hold images too, so this reader would match them
)
"""Modules of this package with ``READERS``, in the order in which they are tried. Each module is imported when it is
tried.
"""

HEAD_BYTES: Final = 4096  # number of bytes at the beginning of a file by which its format is recognised


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceCamera:
    """One depth camera of a recorder's file, as far as the file describes it.

    name: name for the camera's folder; depth_scale: metres per grey value, None if unknown; intrinsics: None if the
    file has no lens; T_world_camera: (4, 4), None if the file has no pose; model and serial: of the device, empty if
    unknown; count: number of depth images, None if only reading the whole file would show it; has_times: False if the
    file only numbers the images; number_step: median difference between the numbers of successive images.
    """

    name: str
    width: int
    height: int
    depth_scale: float | None
    intrinsics: Intrinsics | None = None
    T_world_camera: np.ndarray | None = None
    model: str = ""
    serial: str = ""
    count: int | None = None
    has_times: bool = True
    number_step: float = 1.0


def require_counted(path: Path, step: float) -> None:
    """Raise InputError if the times of images cannot be computed from their numbers and their rate, since the numbers
    do not count the images: the median difference between the numbers of successive images, ``step``, is not 1. Such
    numbers may be milliseconds.
    """
    if step != 1.0:
        problem = f"the numbers of successive images differ by {step:g}, so images per second do not give times"
        remedy = "number the images 0, 1, 2 and so on, or give their times as times_s in a sidecar depth.json"
        raise InputError(path, problem, remedy)


@dataclass(frozen=True, slots=True, eq=False)
class SourceFrame:
    """One depth image. camera: index of its camera in ``Source.cameras``. time_s: time on the device's clock, to the
    microsecond; if the camera has no times, the image's number. depth (height, width) uint16, native byte order: grey
    values as in the file, 0 = no reading; 65535 and NaN of the file are converted to 0.
    """

    camera: int
    time_s: float
    depth: np.ndarray


class Source(Protocol):
    """An opened file or folder of a recorder, with its header read and checked.

    notes: sentences on units that were assumed, on missing information and, after reading, on damaged frames.
    """

    path: Path
    cameras: tuple[SourceCamera, ...]

    def frames(self) -> Iterator[SourceFrame]:
        """Yield the depth images in the order of the file, reading one at a time.

        A damaged image is left out with a note; raises InputError if the rest of the file cannot be read.
        """
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Return sentences for the user; they are complete once all frames were read."""
        ...


@dataclass(frozen=True, slots=True)
class Reader:
    """A format of a recorder, with the functions that recognise and open a file or folder in this format.

    matches: function that tests the content, not the ending of the name; it gets a path and the first 4096 bytes of a
    file, or no bytes for a folder. open_source: function that opens the path; it raises InputError if the header cannot
    be used, MissingPackage if an optional package is missing.
    """

    matches: Callable[[Path, bytes], bool]
    open_source: Callable[[Path], Source]


def movement_note(positions_m: np.ndarray) -> tuple[str, ...]:
    """Return one sentence if the camera's positions over time, ``positions_m`` (n, 3), show that the camera was moved,
    else no sentence. A row of NaN is an unknown position.
    """
    known = positions_m[np.isfinite(positions_m).all(axis=1)]
    if len(known) == 0:
        return ()
    moved_m = float(np.linalg.norm(known - np.median(known, axis=0), axis=1).max())
    if moved_m <= STANDS_STILL_M:
        return ()
    return (f"The camera was moved by {moved_m:.2f} m while it recorded: tracking needs a camera that stands still.",)


def find_reader(path: Path) -> Reader | None:
    """Return the reader that recognises a file or folder by its content; None if no reader does.

    Raises InputError if the path cannot be read, or if only the vendor's software can read this format.
    """
    if not path.exists():
        raise InputError(path, "there is no such file or folder", "check the path")
    try:
        head = b"" if path.is_dir() else _head(path)
        refused = _vendors_own(path, head)
        if refused is not None:  # tested before the readers, since ros_bags would accept a ZED's .svo2, an MCAP file
            raise InputError(path, *refused)
        modules = (import_module(f"anchorpose.sources.{name}") for name in MODULES)
        return next((reader for each in modules for reader in each.READERS if reader.matches(path, head)), None)
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "check the file and its permissions") from None


def open_source(path: Path) -> Source:
    """Open a recorder's file or folder; raises InputError if no reader recognises the path, or if the header cannot be
    used.
    """
    if (path / "recording.json").is_file():
        raise InputError(path, "is a recording already", "give it to 'anchorpose track' as it is")
    reader = find_reader(path)
    if reader is None:
        raise InputError(path, "is in no format that can be read", "see docs/guide/convert.md for the formats that can")
    try:
        return reader.open_source(path)
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "check the file and its permissions") from None


def _head(path: Path) -> bytes:
    with open_regular(path) as file:
        return file.read(HEAD_BYTES)


def json_object(path: Path) -> dict[str, Any] | None:
    """Return the object in a JSON file; None if the file cannot be read or holds anything else."""
    try:
        values = parse_json(read_bounded(path, LARGEST_BYTES))
    except (Unreadable, ValueError):
        return None
    return values if isinstance(values, dict) else None


def finite(value: Any) -> float | None:
    """Return a value of a JSON file as a float if it is a finite number; None for anything else."""
    number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300
    return float(value) if number and math.isfinite(value) else None


def finite_list(value: Any, count: int) -> list[float] | None:
    """Return a value of a JSON file if it is a list of ``count`` finite numbers; None for anything else."""
    if not isinstance(value, list) or len(value) != count:
        return None
    numbers = [number for cell in value if (number := finite(cell)) is not None]
    return numbers if len(numbers) == count else None


def read_matrix(path: Path, rows: int, columns: int) -> np.ndarray:
    """Read a matrix (rows, columns) float64 from a text file with spaces or commas between numbers; raises InputError
    if the file is not a matrix of this size.
    """
    try:
        cells = [line.replace(",", " ").split() for line in read_text(path).splitlines() if line.strip()]
        matrix = np.array(cells, dtype=np.float64)
    except ValueError:
        matrix = np.empty(0)
    if matrix.shape != (rows, columns) or not np.isfinite(matrix).all():
        raise InputError(path, f"is not a matrix of {rows} x {columns} numbers", "export it again")
    return matrix


OTHERS_OWN: Final = (
    (
        b"EVENTS1\0",
        "is a Kinect Studio recording (.xef), which holds depth only for Microsoft's software",
        "play it in Kinect Studio while another program saves the depth images as 16-bit PNG, and convert their folder",
    ),
    (
        b"NI10",
        "is an OpenNI recording (.oni), which only OpenNI unpacks",
        "export its depth images as 16-bit PNG with OpenNI's NiViewer or a few lines of OpenNI's Python package, and "
        "convert their folder",
    ),
    (b"MATLAB 7.3", "is a MATLAB file of version 7.3", "save it again in MATLAB with '-v7'"),
)
"""For each format that only the vendor's software reads: the first bytes of a file, a description, and a workaround."""


def _vendors_own(path: Path, head: bytes) -> tuple[str, str] | None:
    """Return a description and a workaround for a file that only the vendor's software reads; None for other files.

    A ZED camera's .svo2 file is an MCAP file that states its writer at the beginning; a ZED camera's .svo file is
    recognised only by its name.
    """
    named = path.is_file() and path.suffix.lower() in {".svo", ".svo2"}
    is_mcap = head.startswith(b"\x89MCAP0\r\n")
    is_zed = b"stereolabs" in head[:256] if is_mcap else named
    if is_zed:
        return (
            "is a ZED recording (.svo), which holds two colour videos and no depth",
            "export depth as 16-bit PNG with Stereolabs' ZED SDK (its SVO export sample), and convert their folder",
        )
    return next(((problem, remedy) for mark, problem, remedy in OTHERS_OWN if head.startswith(mark)), None)
