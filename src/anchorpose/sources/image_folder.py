"""Read depth images as one array of NumPy, or as a folder of 16-bit grey PNG or PGM, also in its subfolder ``depth``.

Numbers in the names show which images are missing; a sidecar depth.json may give the lens, the unit and the rate.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
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
)
from anchorpose.recording.regular_file import open_regular
from anchorpose.sources.grey_images import (
    GREY_M,
    FrameFile,
    ImageFiles,
    first_size,
    grey_size,
    images_in,
    number_of,
    to_grey,
)
from anchorpose.sources.source import NO_READING, Reader, SourceCamera, SourceFrame

NEAREST_M: Final = 0.1  # the median of depth in metres lies farther, and in millimetres beyond ``FARTHEST_M``

_NPY: Final = b"\x93NUMPY"


class DepthArray:
    """Depth images in one file (images, height, width), uint16 or metres, from byte ``start`` on."""

    notes = ()

    def __init__(self, path: Path, shape: tuple[int, int, int], kind: np.dtype[Any], start: int) -> None:
        self.path, self._shape, self._kind, self._start = path, shape, kind, start
        count, height, width = shape
        if count < 1 or not (0 < height <= LARGEST_SIDE_PX and 0 < width <= LARGEST_SIDE_PX):
            raise InputError(path, f"holds {count} images of {width} x {height} pixels", "save the array again")
        self._metres = kind.kind == "f"
        if not self._metres and (kind.kind != "u" or kind.itemsize != 2):
            raise InputError(path, f"holds numbers of type {kind}", "save depth as uint16, or as metres in float32")
        if self._metres:
            _require_metres(path, self._read(0))
        scale, name = GREY_M if self._metres else None, path.resolve().stem
        self.cameras: tuple[SourceCamera, ...] = (
            SourceCamera(name=name, width=width, height=height, depth_scale=scale, count=count, has_times=False),
        )

    def frames(self, skip: Sequence[int]) -> Iterator[SourceFrame]:
        """Yield the depth images in order; raises InputError where the file ends early."""
        for position in range(skip[0], self._shape[0]):
            image = self._read(position)
            grey = to_grey(image) if self._metres else image.astype(np.uint16)
            grey[grey == NO_READING] = 0
            yield SourceFrame(0, float(position), grey)

    def _read(self, position: int) -> np.ndarray:
        size = math.prod(self._shape[1:]) * self._kind.itemsize
        with open_regular(self.path) as file:
            place = file.seek(self._start + position * size)
            data = file.read(min(size, max(0, self.path.stat().st_size - place)))  # a size may be damaged
        if len(data) < size:
            raise InputError(self.path, f"ends within image {position} of {self._shape[0]}", "copy or save it again")
        return np.frombuffer(data, self._kind).reshape(self._shape[1:])


def _is_array(path: Path, head: bytes) -> bool:
    """Return whether this is an array of NumPy."""
    return head.startswith(_NPY)


def _open_array(path: Path) -> DepthArray:
    """Raises InputError where the array is not of depth images."""
    with open_regular(path) as file:
        try:
            shape, columns, kind = _npy_header(file)
        except Exception:  # NumPy raises whatever a damaged header leads Python's own parser to
            raise InputError(path, "is damaged in its header", "save the array again") from None
        start = file.tell()
    if len(shape) != 3 or columns or kind.hasobject:
        problem = f"holds an array of shape {shape}" + (" in MATLAB's order" if columns else "")
        raise InputError(path, problem, "save depth as (images, height, width), with numpy.ascontiguousarray")
    return DepthArray(path, shape, kind, start)


def _require_metres(path: Path, image: np.ndarray) -> None:
    """Raises InputError where the median of what was read cannot be in metres."""
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
LOOK_AT: Final = 100  # images before a folder counts as one without depth: colour may lie among them

FASTEST_S, SLOWEST_S = 0.003, 1.0
"""What two images of a depth camera may be apart; numbers that say otherwise are not times."""


class SidecarDocument(Entry):
    """``depth-sidecar``: what is known of the depth images of a folder."""

    format: Literal["depth-sidecar"]
    version: Version
    depth_scale: Annotated[float, Field(ge=FINEST_DEPTH_SCALE_M, le=COARSEST_DEPTH_SCALE_M)] | None = None
    fps: Rate | None = None
    times_s: tuple[Seconds, ...] | None = None
    intrinsics: LensEntry | None = None
    model: Text | None = None
    serial: Text | None = None


def _is_images(path: Path, head: bytes) -> bool:
    """Return whether a folder, or its ``depth``, holds 16-bit grey images."""
    return path.is_dir() and any(grey_size(file) is not None for file in _images(path)[:LOOK_AT])


def _open_images(path: Path) -> ImageFiles:
    """Raises InputError where the sidecar cannot be used."""
    images = _images(path)
    width, height = first_size(path, images)
    grey = [file for file in images if grey_size(file) is not None]
    notes = [f"Images that are not 16-bit grey were left alone: {len(images) - len(grey)}."] * (len(grey) < len(images))
    files, has_times = frame_files(grey)
    camera = SourceCamera(
        name=path.resolve().name, width=width, height=height, depth_scale=None, count=len(files), has_times=has_times
    )
    if (path / SIDECAR).is_file():
        camera, files = _described(path / SIDECAR, camera, files)
    return ImageFiles(path, camera, files, notes)


def frame_files(images: list[Path]) -> tuple[list[FrameFile], bool]:
    """Return the images with their times by ``<number>-<microseconds>`` in their names, else their numbers; and whether
    these are times. Images whose names hold no number of their own are counted."""
    stamps = [re.fullmatch(r"\D*\d+-(\d{9,})", file.stem) for file in images]
    micros = [int(stamp[1]) for stamp in stamps if stamp is not None]
    if len(micros) == len(images) > 1 and FASTEST_S < np.median(np.diff(sorted(micros))) / 1e6 < SLOWEST_S:
        timed = sorted(zip(micros, images, strict=True))
        return [FrameFile(file, micro / 1e6) for micro, file in timed], True
    numbers = [number_of(file) for file in images]
    known = [number for number in numbers if number is not None]
    if len(set(known)) < len(images):
        return [FrameFile(file, float(place)) for place, file in enumerate(images)], False
    return [FrameFile(file, float(number)) for number, file in sorted(zip(known, images, strict=True))], False


def _described(path: Path, camera: SourceCamera, files: list[FrameFile]) -> tuple[SourceCamera, list[FrameFile]]:
    """Return the camera and its numbered files with what the sidecar says; raises InputError where it does not fit."""
    given = read_document(path, SidecarDocument)
    known = replace(
        camera,
        depth_scale=given.depth_scale,
        intrinsics=given.intrinsics.lens() if given.intrinsics is not None else None,
        model=given.model or "",
        serial=given.serial or "",
        has_times=camera.has_times or given.times_s is not None or given.fps is not None,
    )
    times_s = given.times_s
    if times_s is None:
        per_second = given.fps if given.fps is not None and not camera.has_times else 1.0
        times_s = tuple(file.time_s / per_second for file in files)
    elif len(times_s) != len(files):
        problem = f"times_s has {len(times_s)} times for {len(files)} depth images"
        raise InputError(path, problem, "write one time per image")
    return known, [replace(file, time_s=time_s) for file, time_s in zip(files, times_s, strict=True)]


def _images(path: Path) -> list[Path]:
    return images_in(path) or images_in(path / "depth")


READERS: Final = (Reader(_is_array, _open_array), Reader(_is_images, _open_images))
