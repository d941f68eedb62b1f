"""Read depth images from single files (16-bit grey PNG, PGM) and numbers from file names, and turn metres into grey
values.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from statistics import median_low
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.depth_image import decode_grey_png, grey_png_size, largest_png
from anchorpose.recording.regular_file import open_regular
from anchorpose.sources.source import NO_READING, SourceCamera, SourceFrame

ENDINGS: Final = {".png", ".pgm"}

Size = tuple[int, int]
"""Width and height in pixels."""

# Scales to choose from, in metres per grey value. With these scales, the largest 16-bit value stands for 16, 33 and 65
# m. At distances of this size, depth cameras measure in steps that are coarser than the scale.
_SCALES: Final = (0.00025, 0.0005, 0.001)
_WHOLE_MM: Final = 0.01  # tolerance in millimetres within which a reading counts as a whole number of millimetres
_SPARE: Final = 1.25  # assumed maximum ratio of the readings in later images to the largest reading in the first image
GREY_M: Final = _SCALES[0]
"""Metres per grey value for files in metres whose largest reading is unknown until the whole file is read. This scale
represents readings of up to 16.4 m, and rounds them by at most an eighth of a millimetre.
"""


@dataclass(frozen=True, slots=True)
class FrameFile:
    """The file of a depth image, on disk or in an archive. time_s: time of the image on the device's clock, or the
    image's number if times are unknown.
    """

    path: Path
    time_s: float


class ImageFiles:
    """A source of one camera whose depth images are single files, or parts of one file. read: function that decodes the
    image at a position in ``files``. It returns the image (height, width) uint16 and an empty text, or None and the
    problem. By default, it decodes the file at this position.
    """

    def __init__(
        self,
        path: Path,
        camera: SourceCamera,
        files: Sequence[FrameFile],
        notes: Sequence[str] = (),
        read: Callable[[int], tuple[np.ndarray | None, str]] | None = None,
    ) -> None:
        if not files:
            raise InputError(path, "holds no depth images", "give the folder with 16-bit PNG or PGM images")
        self.path = path
        step = 1.0 if camera.has_times else number_step([file.time_s for file in files])
        self.cameras: tuple[SourceCamera, ...] = (replace(camera, number_step=step, count=len(files)),)
        self._files, self._notes = files, tuple(notes)
        self._read = read or (lambda position: read_grey_image(files[position].path, camera))
        self._left_out: dict[str, str] = {}

    @property
    def notes(self) -> tuple[str, ...]:
        """Return sentences for the user; they are complete once all frames were read."""
        if not self._left_out:
            return self._notes
        first, problem = next(iter(self._left_out.items()))
        damaged = f"Damaged depth images that were left out: {len(self._left_out)}; the first, {first}, {problem}."
        return (*self._notes, damaged)

    @property
    def in_one_file(self) -> bool:
        """Return whether all images are parts of one file; none of them is then left out as damaged."""
        return self._files[0].path == self._files[-1].path

    def frames(self, first: int = 0) -> Iterator[SourceFrame]:
        """Yield the depth images in order, from the position ``first`` on. Raises InputError if all images are in one
        file and this file ends before the last image is complete.
        """
        for position, file in islice(enumerate(self._files), first, None):
            grey, problem = self._read(position)
            if grey is None:
                self._left_out[file.path.name] = problem
                continue
            grey[grey == NO_READING] = 0
            yield SourceFrame(0, file.time_s, grey)


def read_grey_image(path: Path, camera: SourceCamera) -> tuple[np.ndarray | None, str]:
    """Read a PNG or PGM file; return its grey values (height, width) uint16 and an empty text, or None and the problem.

    Raises OSError if the file cannot be read, for example because a disk was unplugged: such an image does not count as
    damaged, so the conversion can be resumed.
    """
    with open_regular(path) as file:
        data = file.read(largest_png(camera.width, camera.height) + 1)
    if data[:2] == b"P5":
        return _decode_pgm(data, camera)
    return decode_grey_png(data, camera.width, camera.height)


def grey_size(path: Path) -> Size | None:
    """Return the size of an image from its header; None unless it is a 16-bit grey PNG or PGM file."""
    try:
        with open_regular(path) as file:
            head = file.read(512)
    except OSError:
        return None
    if head[:2] != b"P5":
        size = grey_png_size(head)
    else:
        header = _pgm_header(head)
        size = header[:2] if header is not None else None
    return size if size is not None and min(size) > 0 else None


def first_size(path: Path, files: Sequence[Path]) -> Size:
    """Return the size of the first image that is 16-bit grey; raises InputError if no image is."""
    for file in files:
        size = grey_size(file)
        if size is not None:
            return size
    raise InputError(path, "holds no 16-bit grey PNG or PGM image", "save depth with 16 bits, without colour")


def images_in(folder: Path) -> list[Path]:
    """Return the PNG and PGM files of a folder, in natural order of their names: 2 before 10."""
    if not folder.is_dir():
        return []
    files = [file for file in folder.iterdir() if file.suffix.lower() in ENDINGS and not file.name.startswith(".")]
    return sorted(files, key=natural_order)


def natural_order(path: Path) -> tuple[tuple[bool, int, str], ...]:
    """Return a sort key by which numbers in file names are compared as numbers: 2 before 10."""
    parts = re.findall(r"[0-9]+|[^0-9]+", path.name)
    return tuple((part[0] in "0123456789", int(part[:18]) if part[0] in "0123456789" else 0, part) for part in parts)


def number_of(path: Path) -> int | None:
    """Return the number in a file's name; None if the name has no number, several numbers, or a number with too many
    digits to be an image's number.
    """
    numbers = re.findall(r"[0-9]+", path.stem)
    return int(numbers[0]) if len(numbers) == 1 and len(numbers[0]) <= 9 else None


def number_step(numbers: Sequence[float]) -> float:
    """Return the median difference between the numbers of successive images; 1 for a single image."""
    return float(median_low(np.diff(numbers).tolist())) if len(numbers) > 1 else 1.0


def _pgm_header(data: bytes) -> tuple[int, int, int] | None:
    """Return width, height and offset of the pixels of a PGM file with two bytes per pixel; None for other files."""
    gap = rb"(?:\s|#[^\n]*\n)+"
    match = re.match(rb"P5" + gap + rb"(\d{1,5})" + gap + rb"(\d{1,5})" + gap + rb"(\d{1,5})\s", data)
    if match is None or not 255 < int(match[3]) < 65536:
        return None
    return int(match[1]), int(match[2]), match.end()


def _decode_pgm(data: bytes, camera: SourceCamera) -> tuple[np.ndarray | None, str]:
    header = _pgm_header(data[:512])
    if header is None:
        return None, "is not a PGM file with 16 bits per pixel"
    width, height, start = header
    if (width, height) != (camera.width, camera.height):
        return None, f"is {width} x {height}, the others are {camera.width} x {camera.height} pixels"
    pixels = data[start : start + 2 * width * height]
    if len(pixels) < 2 * width * height:
        return None, "is truncated"
    return np.frombuffer(pixels, ">u2").reshape(height, width).astype(np.uint16), ""  # PGM is big-endian


def scale_of(metres: np.ndarray) -> float | None:
    """Choose the metres per grey value for a camera from an image (height, width) in metres; None without a reading.

    The result is 0.001 (grey values in millimetres) if all readings are whole millimetres. Otherwise the result is the
    finest of the ``_SCALES`` that can represent a quarter more than the largest reading, or the coarsest if none can.
    """
    given = metres[np.isfinite(metres)].astype(np.float64)
    if given.size == 0:
        return None
    if np.abs(given * 1000.0 - np.round(given * 1000.0)).max() < _WHOLE_MM:
        return 0.001
    return next((scale for scale in _SCALES if given.max() * _SPARE <= (NO_READING - 1) * scale), _SCALES[-1])


def grey_of_metres(metres: np.ndarray, scale: float) -> tuple[np.ndarray, int]:
    """Convert metres (height, width) to grey values uint16, 0 = no reading; also return the number of readings that are
    too far for the scale; they become 0.
    """
    with np.errstate(invalid="ignore"):
        grey = np.round(metres.astype(np.float64) / scale)
    too_far = np.isfinite(grey) & (grey >= NO_READING)
    grey[~np.isfinite(grey) | too_far | (grey < 0.0)] = 0.0
    return grey.astype(np.uint16), int(too_far.sum())


def to_grey(depth_m: np.ndarray) -> np.ndarray:
    """Convert (height, width) metres to uint16 in steps of ``GREY_M``; 0 without a reading or beyond 16.4 m."""
    return grey_of_metres(np.asarray(depth_m), GREY_M)[0]
