"""Depth images as one array: NumPy's .npy of (images, height, width), MATLAB's .mat of (height, width, images)."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.regular_file import LARGEST_ARRAYS, open_regular, read_whole
from anchorpose.sources.bag_file import read_at_most
from anchorpose.sources.metres import GREY_M, to_grey
from anchorpose.sources.source import NO_READING, SourceCamera, SourceFrame

NEAREST_M, FARTHEST_M = 0.1, 50.0
"""Between these lies the median of depth in metres; depth in millimetres is far beyond."""

LARGEST_SIDE: Final = 16384

_MATRIX, _COMPRESSED, _COMPLEX, _MAT_HEADER = 14, 15, 0x800, 128
_CLASSES: Final = {6: "f8", 7: "f4", 11: "u2"}  # of arrays that can be depth
_NUMBERS: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}

_NPY, _MAT, _MAT_73 = b"\x93NUMPY", b"MATLAB 5.0", b"MATLAB 7.3"

ReadImage = Callable[[int], np.ndarray]


def matches(path: Path, head: bytes) -> bool:
    """Whether this is one of the two formats."""
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
        """None: an array has no damaged images."""
        return ()

    def frames(self, skip: Sequence[int]) -> Iterator[SourceFrame]:
        """The depth images in order; raises InputError where the file ends early."""
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
            file.seek(start + position * pixels * kind.itemsize)
            data = read_at_most(file, pixels * kind.itemsize)
        if len(data) < pixels * kind.itemsize:
            raise InputError(path, f"ends within image {position} of {shape[0]}", "copy or save it again")
        return np.frombuffer(data, kind).reshape(shape[1:])

    return DepthArray(path, shape, kind, read)


def _npy_header(file: BinaryIO) -> tuple[Any, bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(file)
    return np.lib.format.read_array_header_2_0(file)


@dataclass(frozen=True, slots=True, eq=False)
class _Matrix:
    """A numeric array of a MATLAB file: the numbers as they are stored, which may be smaller than its own kind."""

    name: str
    shape: tuple[int, ...]
    kind: np.dtype[Any]
    stored: np.ndarray


def _open_mat(path: Path) -> DepthArray:
    """MATLAB's files cannot be read in part: the array is held whole."""
    try:
        candidates = list(_depth_matrices(memoryview(read_whole(path, LARGEST_ARRAYS, "save it again with '-v7'"))))
    except (ValueError, struct.error, zlib.error):
        raise InputError(path, "is damaged, or of a kind that cannot be read", "save it again with '-v7'") from None
    named = [matrix for matrix in candidates if "depth" in matrix.name.lower()] or candidates
    if len(named) != 1:
        problem = f"holds {len(named)} arrays that could be depth images"
        raise InputError(path, problem, "save one array 'depth' of (height, width, images), uint16 or metres")
    height, width, count = named[0].shape
    images, kind = named[0].stored.reshape(count, width, height), named[0].kind  # column by column
    return DepthArray(path, (count, height, width), kind, lambda position: images[position].T.astype(kind))


def _depth_matrices(data: memoryview) -> Iterator[_Matrix]:
    """Arrays of three dimensions, uint16 or floating-point (MATLAB's "MAT-File Format", level 5).

    Read here because scipy's reader can crash on damaged files. Raises ValueError, struct.error and zlib.error.
    """
    order = ">" if data[126:128] == b"MI" else "<"
    for kind, content in _elements(data[_MAT_HEADER:], order):
        if kind == _COMPRESSED:
            ((kind, content),) = _elements(memoryview(zlib.decompress(content)), order)
        if kind == _MATRIX:
            matrix = _depth_matrix(list(_elements(content, order)), order)
            if matrix is not None:
                yield matrix


def _depth_matrix(parts: list[tuple[int, memoryview]], order: str) -> _Matrix | None:
    flag = struct.unpack_from(order + "I", parts[0][1])[0] if parts else 0
    kind = _CLASSES.get(flag & 0xFF)
    if kind is None or flag & _COMPLEX:
        return None
    if len(parts) < 4:
        raise ValueError("an array is not complete")
    (_, sizes), (_, name), (stored, numbers) = parts[1:4]
    shape = tuple(np.frombuffer(sizes, order + "i4").tolist())
    if len(shape) != 3:
        return None
    if min(shape) < 1 or stored not in _NUMBERS:
        raise ValueError("an array has no numbers")
    values = np.frombuffer(numbers, order + _NUMBERS[stored])
    if len(values) != math.prod(shape):
        raise ValueError("an array has more or fewer numbers than its shape")
    return _Matrix(bytes(name).decode("latin-1"), shape, np.dtype(kind), values)


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type and content of each element; a short one has both in eight bytes."""
    place = 0
    while place < len(data):
        kind, size = struct.unpack_from(order + "II", data, place)
        start = place + 8
        if kind >> 16:
            kind, size, start = kind & 0xFFFF, kind >> 16, place + 4
        if start + size > len(data):
            raise ValueError("an element is cut off")
        yield kind, data[start : start + size]
        place = start + size if kind == _COMPRESSED else start + size + -(start + size) % 8
