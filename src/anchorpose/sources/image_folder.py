"""Read depth images from an array file, from a folder of image files, or from raw dumps that a sidecar describes.

An array file is a NumPy .npy file with an array (images, height, width). A folder has 16-bit grey PNG or PGM files,
also in a subfolder ``depth``. Raw dumps hold 16-bit values, either one file for all images, or a folder with one file
per image. Numbers in the file names show which images are missing. A sidecar (a JSON file) may give the lens, the unit
and the rate.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Final, Literal

import numpy as np
from pydantic import Field

from anchorpose.errors import InputError
from anchorpose.recording.depth_image import FARTHEST_M
from anchorpose.recording.document import Entry, Text, Version, read_document
from anchorpose.recording.recording_file import (
    COARSEST_DEPTH_SCALE_M,
    FINEST_DEPTH_SCALE_M,
    LARGEST_SIDE_PX,
    LensEntry,
    Rate,
    Seconds,
    Size,
)
from anchorpose.recording.regular_file import open_regular
from anchorpose.sources.grey_images import (
    GREY_M,
    FrameFile,
    ImageFiles,
    first_size,
    grey_size,
    images_in,
    natural_order,
    number_of,
    number_step,
    to_grey,
)
from anchorpose.sources.source import Reader, SourceCamera, json_object, require_counted

# m, minimum median of an image's readings; a smaller median shows that the unit is not metres. If the unit of an image
# is millimetres, the median of its readings exceeds the maximum, ``FARTHEST_M``.
NEAREST_M: Final = 0.1

_NPY: Final = b"\x93NUMPY"  # first bytes of NumPy's files


def _reader(path: Path, start: int, shape: tuple[int, ...], kind: np.dtype[Any]) -> Callable[[int], np.ndarray]:
    """Return a function that reads the image at a position; it raises InputError if the file ends within this image."""
    size = math.prod(shape) * kind.itemsize

    def read(position: int) -> np.ndarray:
        with open_regular(path) as file:
            place = file.seek(start + position * size)
            data = file.read(min(size, max(0, path.stat().st_size - place)))  # the file's header may state a wrong size
        if len(data) < size:
            raise InputError(path, f"ends within image {position}", "copy or save it again")
        return np.frombuffer(data, kind).reshape(shape)

    return read


def _open_array(path: Path) -> ImageFiles:
    """Open an array of NumPy; raises InputError if it does not hold depth images."""
    with open_regular(path) as file:
        try:
            shape, columns, kind = _npy_header(file)
        except Exception:  # a damaged header can raise any error of NumPy's header parser
            raise InputError(path, "is damaged in its header", "save the array again") from None
        start = file.tell()
    if len(shape) != 3 or columns or kind.hasobject:
        problem = f"holds an array of shape {shape}" + (" in MATLAB's order" if columns else "")
        raise InputError(path, problem, "save depth as (images, height, width), with numpy.ascontiguousarray")
    # If the header states too many images, the array gets one image more than the file has room for. An attempt to read
    # the image for which the file has no room then reports that the end of the file is missing.
    most = path.stat().st_size // max(1, math.prod(shape[1:]) * kind.itemsize) + 1
    return image_array(path, (min(shape[0], most), *shape[1:]), kind, _reader(path, start, shape[1:], kind))


def image_array(
    path: Path, shape: tuple[int, int, int], kind: np.dtype[Any], read: Callable[[int], np.ndarray]
) -> ImageFiles:
    """Make the source of an array with the shape (images, height, width) and numbers of the type ``kind``. read:
    function that returns the image at a position as it is stored.

    Raises InputError if the array's size or its numbers are impossible for depth images.
    """
    count, height, width = shape
    if count < 1 or not (0 < height <= LARGEST_SIDE_PX and 0 < width <= LARGEST_SIDE_PX):
        raise InputError(path, f"holds {count} images of {width} x {height} pixels", "save the array again")
    metres = kind.kind == "f"
    if not metres and (kind.kind != "u" or kind.itemsize != 2):
        raise InputError(path, f"holds numbers of type {kind}", "save depth as uint16, or as metres in float32")
    if metres:
        _require_metres(path, read(0))
    name, scale = path.resolve().stem, GREY_M if metres else None
    camera = SourceCamera(name=name, width=width, height=height, depth_scale=scale, has_times=False)

    def read_grey(position: int) -> tuple[np.ndarray, str]:
        image = read(position)
        return to_grey(image) if metres else image.astype(np.uint16), ""

    return ImageFiles(path, camera, [FrameFile(path, float(number)) for number in range(count)], read=read_grey)


def _require_metres(path: Path, image: np.ndarray) -> None:
    """Raise InputError if the median of an image's readings cannot be a distance in metres."""
    seen = image[np.isfinite(image) & (image > 0)]
    if len(seen) and not NEAREST_M < float(np.median(seen)) < FARTHEST_M:
        problem = f"holds depth of {float(np.median(seen)):.4g} in the middle, which is no distance in metres"
        raise InputError(path, problem, "save depth in metres, or as uint16 and give --depth-scale")


def _npy_header(file: BinaryIO) -> tuple[Any, bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(file)
    return np.lib.format.read_array_header_2_0(file)


SIDECAR: Final = "depth.json"
"""Name of the sidecar of a folder; the sidecar of a single file has the file's name with the ending .json."""

# Maximum number of images of a folder that are tested. At least one of the tested images must be 16-bit grey; the
# others may be colour images.
LOOK_AT: Final = 100

FASTEST_S, SLOWEST_S = 0.003, 1.0
"""Minimum and maximum time in s between two images of a depth camera. If the median difference of the numbers in file
names is outside these limits, the numbers are not times.
"""


class SidecarDocument(Entry):
    """A ``depth-sidecar``, a file that describes depth images; only raw dumps need ``width`` and ``height``."""

    format: Literal["depth-sidecar"]
    version: Version
    width: Size | None = None
    height: Size | None = None
    byte_order: Literal["little", "big"] = "little"
    depth_scale: Annotated[float, Field(ge=FINEST_DEPTH_SCALE_M, le=COARSEST_DEPTH_SCALE_M)] | None = None
    fps: Rate | None = None
    times_s: tuple[Seconds, ...] | None = None
    intrinsics: LensEntry | None = None
    model: Text | None = None
    serial: Text | None = None


def _is_images(path: Path, head: bytes) -> bool:
    """Return whether a folder, or its subfolder ``depth``, holds 16-bit grey images."""
    return path.is_dir() and any(grey_size(file) is not None for file in _images(path)[:LOOK_AT])


def _open_images(path: Path) -> ImageFiles:
    """Open a folder of images; raises InputError if its sidecar cannot be used."""
    images = _images(path)
    width, height = first_size(path, images)
    grey = [file for file in images if grey_size(file) is not None]
    notes = [f"Images that are not 16-bit grey were left alone: {len(images) - len(grey)}."] * (len(grey) < len(images))
    files, has_times = frame_files(grey)
    camera = SourceCamera(name=path.resolve().name, width=width, height=height, depth_scale=None, has_times=has_times)
    if (path / SIDECAR).is_file():
        given = read_document(path / SIDECAR, SidecarDocument)
        camera, files = camera_of(given, camera, path / SIDECAR), with_times(given, path / SIDECAR, files)
    return ImageFiles(path, camera, files, notes)


def frame_files(images: list[Path]) -> tuple[Sequence[FrameFile], bool]:
    """Return the images with the times in their names, and True, if all names have the form
    ``<number>-<microseconds>``, the times have the intervals of a depth camera, and they are not times of day
    (``<date>-<HHMMSSffffff>``). Otherwise return the images with the numbers in their names, or with their positions if
    numbers are missing or repeated; and False.
    """
    stamps = [re.fullmatch(r"\D*\d+-(\d{9,})", file.stem) for file in images]
    micros = [int(stamp[1]) for stamp in stamps if stamp is not None]
    is_timed = len(micros) == len(images) > 1 and FASTEST_S < np.median(np.diff(sorted(micros))) / 1e6 < SLOWEST_S
    if is_timed and not _are_clock_times(micros):
        timed = sorted(zip(micros, images, strict=True))
        return [FrameFile(file, micro / 1e6) for micro, file in timed], True
    numbers = [number_of(file) for file in images]
    known = [number for number in numbers if number is not None]
    if len(set(known)) < len(images):
        return [FrameFile(file, float(place)) for place, file in enumerate(images)], False
    return [FrameFile(file, float(number)) for number, file in sorted(zip(known, images, strict=True))], False


def _are_clock_times(micros: Sequence[int]) -> bool:
    """Return whether the numbers are times of day (HHMMSSffffff), not counts of microseconds. This is so if the last
    twelve digits of every number can be a time of day, and if the intervals between these times differ from the
    intervals between the numbers taken as microseconds. If all times lie in the same minute, both interpretations give
    the same intervals, and the result is False.
    """
    shifts = set[int]()
    for micro in micros:
        hour, minute, second = micro // 10**10 % 100, micro // 10**8 % 100, micro // 10**6 % 100
        if hour > 23 or minute > 59 or second > 59:
            return False
        shifts.add(micro - ((60 * hour + minute) * 60 + second) * 10**6 - micro % 10**6)
    return len(shifts) > 1


def camera_of(given: SidecarDocument, camera: SourceCamera, path: Path) -> SourceCamera:
    """Return ``camera`` completed by the sidecar ``given``; raises InputError if the sidecar states another image
    size.
    """
    for name, own, said in (("width", camera.width, given.width), ("height", camera.height, given.height)):
        if said is not None and said != own:
            raise InputError(path, f"{name} is {said}, the images have {own}", "correct the number")
    return replace(
        camera,
        depth_scale=given.depth_scale,
        intrinsics=given.intrinsics.lens() if given.intrinsics is not None else None,
        model=given.model or "",
        serial=given.serial or "",
        has_times=camera.has_times or given.times_s is not None or given.fps is not None,
    )


def with_times(given: SidecarDocument, path: Path, files: Sequence[FrameFile]) -> Sequence[FrameFile]:
    """Return the files with the times that the sidecar ``given`` states in place of their numbers; unchanged if the
    sidecar has neither times nor a rate. Raises InputError if the sidecar does not have one time per file, or if it has
    a rate although the files' numbers do not count the images.
    """
    if given.times_s is not None:
        if len(given.times_s) != len(files):
            problem = f"times_s has {len(given.times_s)} times for {len(files)} depth images"
            raise InputError(path, problem, "write one time per image")
        return [replace(file, time_s=time_s) for file, time_s in zip(files, given.times_s, strict=True)]
    if given.fps is None:
        return files
    require_counted(path, number_step([file.time_s for file in files]))
    return [replace(file, time_s=file.time_s / given.fps) for file in files]


def _images(path: Path) -> list[Path]:
    return images_in(path) or images_in(path / "depth")


def _is_raw_dump(path: Path, head: bytes) -> bool:
    """Return whether ``path`` is a file with a sidecar beside it, or a folder of raw files with a sidecar in it."""
    sidecar = _sidecar(path)
    values = None if sidecar == path else json_object(sidecar)
    described = values is not None and values.get("format") == "depth-sidecar"
    return described and (path.is_file() or bool(_raw_files(path)))


def _open_raw(path: Path) -> ImageFiles:
    """Open a raw dump; raises InputError if its sidecar cannot be used or does not fit the files."""
    sidecar = _sidecar(path)
    given = read_document(sidecar, SidecarDocument)
    if given.width is None or given.height is None:
        raise InputError(sidecar, "has no width and height", "add both: raw images do not state their size")
    name = path.resolve().stem if path.is_file() else path.resolve().name
    camera = camera_of(
        given,
        SourceCamera(name=name, width=given.width, height=given.height, depth_scale=None, has_times=False),
        sidecar,
    )
    order = ">u2" if given.byte_order == "big" else "<u2"
    if path.is_file():
        return _open_raw_file(path, camera, order, given)
    files, _ = frame_files(sorted(_raw_files(path), key=natural_order))
    files = with_times(given, sidecar, files)
    return ImageFiles(path, camera, files, read=lambda position: _read_raw(files[position].path, camera, order))


def _open_raw_file(path: Path, camera: SourceCamera, order: str, given: SidecarDocument) -> ImageFiles:
    kind = np.dtype(order)
    count, rest = divmod(path.stat().st_size, kind.itemsize * camera.width * camera.height)
    if count == 0:
        problem = f"is shorter than one image of {camera.width} x {camera.height} pixels"
        raise InputError(path, problem, "check width and height in its sidecar")
    files = with_times(given, _sidecar(path), [FrameFile(path, float(number)) for number in range(count)])
    cut = f"{path.name} ends within an image, which was left out; its sidecar's width and height may be wrong."
    read = _reader(path, 0, (camera.height, camera.width), kind)
    notes = (cut,) if rest else ()
    return ImageFiles(path, camera, files, notes, lambda position: (read(position).astype(np.uint16), ""))


def _read_raw(path: Path, camera: SourceCamera, order: str) -> tuple[np.ndarray | None, str]:
    wanted, size = 2 * camera.width * camera.height, path.stat().st_size
    if size != wanted:
        return None, f"has {size} bytes, an image of this size has {wanted}"
    with open_regular(path) as file:
        data = file.read(wanted)
    return np.frombuffer(data, order).reshape(camera.height, camera.width).astype(np.uint16), ""


def _sidecar(path: Path) -> Path:
    return path / SIDECAR if path.is_dir() else path.with_suffix(".json")


def _raw_files(folder: Path) -> list[Path]:
    return [file for file in folder.iterdir() if file.suffix.lower() in {".raw", ".bin"} and file.name[0] != "."]


READERS: Final = (
    Reader(lambda _, head: head.startswith(_NPY), _open_array),
    Reader(_is_raw_dump, _open_raw),
    Reader(_is_images, _open_images),
)
