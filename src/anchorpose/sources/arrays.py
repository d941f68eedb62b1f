"""Depth images as one array: NumPy's .npy of (images, height, width), MATLAB's .mat of (height, width, images)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.regular_file import LARGEST_ARRAYS, open_regular, read_whole
from anchorpose.sources.grey_images import GREY_M, to_grey
from anchorpose.sources.mat_file import list_arrays
from anchorpose.sources.source import NO_READING, Reader, SourceCamera, SourceFrame

NEAREST_M, FARTHEST_M = 0.1, 50.0
"""Between these lies the median of depth in metres; depth in millimetres is far beyond."""

LARGEST_SIDE: Final = 16384

_NPY, _MAT, _MAT_73 = b"\x93NUMPY", b"MATLAB 5.0", b"MATLAB 7.3"

ReadImage = Callable[[int], np.ndarray]


def matches(path: Path, head: bytes) -> bool:
    """Return whether this is one of the two formats."""
    return head.startswith((_NPY, _MAT, _MAT_73))


def open_source(path: Path) -> DepthArray:
    """Raises InputError where the array is not of depth images."""
    with open_regular(path) as file:
        head = file.read(len(_MAT))
    if head.startswith(_MAT_73):
        raise InputError(path, "is a MATLAB file of version 7.3", "save it again in MATLAB with '-v7'")
    return _open_npy(path) if head.startswith(_NPY) else _open_mat(path)


class DepthArray:
    """An array of depth images; ``read`` gives the image at a position (height, width)."""

    def __init__(self, path: Path, shape: tuple[int, int, int], kind: np.dtype[Any], read: ReadImage) -> None:
        count, height, width = shape
        if count < 1 or not (0 < height <= LARGEST_SIDE and 0 < width <= LARGEST_SIDE):
            raise InputError(path, f"holds {count} images of {width} x {height} pixels", "save the array again")
        self._metres = kind.kind == "f"
        if not self._metres and (kind.kind != "u" or kind.itemsize != 2):
            raise InputError(path, f"holds numbers of type {kind}", "save depth as uint16, or as metres in float32")
        if self._metres:
            _require_metres(path, read(0))
        scale = GREY_M if self._metres else None
        name = path.resolve().stem
        self.path, self._read, self._count = path, read, count
        self.cameras: tuple[SourceCamera, ...] = (
            SourceCamera(name=name, width=width, height=height, depth_scale=scale, count=count, has_times=False),
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Return no notes: an array has no damaged images."""
        return ()

    def frames(self, skip: Sequence[int]) -> Iterator[SourceFrame]:
        """Yield the depth images in order; raises InputError where the file ends early."""
        for position in range(skip[0], self._count):
            image = self._read(position)
            grey = to_grey(image) if self._metres else image.astype(np.uint16)
            grey[grey == NO_READING] = 0
            yield SourceFrame(0, float(position), grey)


def _require_metres(path: Path, image: np.ndarray) -> None:
    """Raises InputError where the median of what was read cannot be in metres."""
    seen = image[np.isfinite(image) & (image > 0)]
    if len(seen) and not NEAREST_M < float(np.median(seen)) < FARTHEST_M:
        problem = f"holds depth of {float(np.median(seen)):.4g} in the middle, which is no distance in metres"
        raise InputError(path, problem, "save depth in metres, or as uint16 and give --depth-scale")


def _open_npy(path: Path) -> DepthArray:
    with open_regular(path) as file:
        try:
            shape, columns, kind = _npy_header(file)
        except Exception:  # NumPy raises whatever a damaged header leads Python's own parser to
            raise InputError(path, "is damaged in its header", "save the array again") from None
        start = file.tell()
    if len(shape) != 3 or columns or kind.hasobject:
        problem = f"holds an array of shape {shape}" + (" in MATLAB's order" if columns else "")
        raise InputError(path, problem, "save depth as (images, height, width), with numpy.ascontiguousarray")
    pixels = shape[1] * shape[2]

    def read(position: int) -> np.ndarray:
        with open_regular(path) as file:
            place = file.seek(start + position * pixels * kind.itemsize)
            data = file.read(min(pixels * kind.itemsize, max(0, path.stat().st_size - place)))  # a size may be damaged
        if len(data) < pixels * kind.itemsize:
            raise InputError(path, f"ends within image {position} of {shape[0]}", "copy or save it again")
        return np.frombuffer(data, kind).reshape(shape[1:])

    return DepthArray(path, shape, kind, read)


def _npy_header(file: BinaryIO) -> tuple[Any, bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(file)
    return np.lib.format.read_array_header_2_0(file)


def _open_mat(path: Path) -> DepthArray:
    """Open a MATLAB file, which cannot be read in part: the array is held whole.

    A damaged or cut off file is refused.
    """
    data = memoryview(read_whole(path, LARGEST_ARRAYS, "save it in several files, or as .npy"))
    try:
        arrays = [array for array in list_arrays(data) if len(array.shape) == 3]
        named = [array for array in arrays if "depth" in array.name.lower()] or arrays
        large = sum(array.size_bytes for array in named) > LARGEST_ARRAYS
        images = named[0].read() if len(named) == 1 and not large else np.empty(0)
    except (ValueError, LookupError, StopIteration, struct.error, zlib.error, MemoryError):
        raise InputError(path, "is damaged, or of a kind that cannot be read", "save it again with '-v7'") from None
    if len(named) != 1:
        problem = f"holds {len(named)} arrays that could be depth images"
        raise InputError(path, problem, "save one array 'depth' of (height, width, images), uint16 or metres")
    if large:
        raise InputError(path, "holds more than fits into memory", "save it in several files, or as .npy")
    height, width, count = named[0].shape
    return DepthArray(path, (count, height, width), images.dtype, lambda position: images[:, :, position])


READERS: Final = (Reader(matches, open_source),)
