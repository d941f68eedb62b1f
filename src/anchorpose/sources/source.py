"""Find the reader of a recorder's file by its content; it returns the cameras and their depth images one by one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from anchorpose.errors import InputError
from anchorpose.lens import Intrinsics
from anchorpose.recording.document import read_text
from anchorpose.recording.regular_file import open_regular

MILLIMETRE_M: Final = 0.001

NO_READING: Final = 65535  # value that, like 0, marks "too far" or "too near"

# m, maximum movement of a resting camera; the estimated position of a phone on a tripod drifts by some millimetres
STANDS_STILL_M: Final = 0.03

MODULES: Final = (
    "azure_kinect",
    "ros_bags",
    "phones",
    "published_folders",
    "mat_file",
    "image_folder",  # tried last, since most formats above include a folder of images
)
"""Modules of this package with ``READERS``, in the order in which they are tried; they are imported one by one."""

HEAD_BYTES: Final = 4096


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceCamera:
    """One depth camera of a recorder's file, as far as the file describes it.

    name: for the camera's folder; depth_scale: metres per grey value, None if unknown; intrinsics: None if the
    file has no lens; T_world_camera: (4, 4) where the file places the camera; model and serial: empty if unknown;
    count: number of its depth images, None if only reading the whole file would show it; has_times: False where the
    file only numbers its images.
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


@dataclass(frozen=True, slots=True, eq=False)
class SourceFrame:
    """One depth image. time_s: time on the device's clock, to the microsecond; if the camera has no times, the image's
    number. depth (height, width) uint16, native byte order: grey values as in the file, where 0 replaces 65535 and NaN;
    0 = no reading.
    """

    camera: int
    time_s: float
    depth: np.ndarray


class Source(Protocol):
    """An opened file or folder of a recorder, with its header read and checked.

    notes: sentences on decisions (units, missing information and, after reading, damaged frames).
    """

    path: Path
    cameras: tuple[SourceCamera, ...]

    def frames(self, skip: Sequence[int]) -> Iterator[SourceFrame]:
        """Yield the depth images in the order of the file, streamed; skip: number of images of each camera to leave
        out.

        A damaged image is left out with a note; raises InputError if the rest of the file cannot be read.
        """
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Return sentences for the user; they are complete once all frames were read."""
        ...


@dataclass(frozen=True, slots=True)
class Reader:
    """A format of a recorder: how it is recognised and opened.

    matches: function that tests the content, not the ending; it gets a path and the first 4096 bytes of a file, or no
    bytes for a folder. open_source: function that opens it; it raises InputError if the header cannot be used,
    MissingPackage if an extra is missing.
    """

    matches: Callable[[Path, bytes], bool]
    open_source: Callable[[Path], Source]


def movement_note(positions_m: np.ndarray) -> tuple[str, ...]:
    """Return a sentence if a camera with the positions ``positions_m`` (n, 3) was moved, else nothing; NaN rows are
    unknown.
    """
    known = positions_m[np.isfinite(positions_m).all(axis=1)]
    if len(known) == 0:
        return ()
    moved_m = float(np.linalg.norm(known - np.median(known, axis=0), axis=1).max())
    if moved_m <= STANDS_STILL_M:
        return ()
    return (f"The camera was moved by {moved_m:.2f} m while it recorded: tracking needs a camera that stands still.",)


def find_reader(path: Path) -> Reader | None:
    """Return the reader that recognises a file or folder by its content, or None.

    Raises InputError if the path cannot be read, or if only its vendor's software can read it.
    """
    if not path.exists():
        raise InputError(path, "there is no such file or folder", "check the path")
    try:
        head = b"" if path.is_dir() else _head(path)
        refused = _vendors_own(path, head)
        if refused is not None:  # tested before ros_bags, since a ZED's .svo2 is an MCAP file
            raise InputError(path, *refused)
        modules = (import_module(f"anchorpose.sources.{name}") for name in MODULES)
        return next((reader for each in modules for reader in each.READERS if reader.matches(path, head)), None)
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "check the file and its permissions") from None


def open_source(path: Path) -> Source:
    """Open a recorder's file or folder; raises InputError if no reader knows it or its header cannot be used."""
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


def finite(value: Any) -> float | None:
    """Return a finite number of a JSON file; None for anything else."""
    number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300
    return float(value) if number and math.isfinite(value) else None


def finite_list(value: Any, count: int) -> list[float] | None:
    """Return a list of so many finite numbers; None for anything else."""
    if not isinstance(value, list) or len(value) != count:
        return None
    numbers = [number for cell in value if (number := finite(cell)) is not None]
    return numbers if len(numbers) == count else None


def read_matrix(path: Path, rows: int, columns: int) -> np.ndarray:
    """Return (rows, columns) float64 of a text file, separated by spaces or commas; raises InputError."""
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
"""First bytes of files that only the vendor's software reads, a description of each, and a workaround."""


def _vendors_own(path: Path, head: bytes) -> tuple[str, str] | None:
    """Return the description of a file that only the vendor's software reads, and a workaround, else None."""
    if _is_zed(path, head):
        return (
            "is a ZED recording (.svo), which holds two colour videos and no depth",
            "export depth as 16-bit PNG with Stereolabs' ZED SDK (its SVO export sample), and convert their folder",
        )
    return next(((problem, remedy) for mark, problem, remedy in OTHERS_OWN if head.startswith(mark)), None)


def _is_zed(path: Path, head: bytes) -> bool:
    """Return whether a ZED wrote a file: an .svo2 is MCAP and states its writer; an .svo is recognised only by its
    name.
    """
    if head.startswith(b"\x89MCAP0\r\n"):
        return b"stereolabs" in head[:256]
    return path.is_file() and path.suffix.lower() in {".svo", ".svo2"}
