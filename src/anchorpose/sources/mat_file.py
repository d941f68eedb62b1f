"""Read depth images from a MATLAB file of level 5 (MathWorks, "MAT-File Format"), compressed or not.

The array must have the shape (height, width, images), and hold uint16 or metres. scipy's reader is not used, since it
trusts the tags (type and size) of the file's elements: a single damaged byte in a tag crashed the process.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.regular_file import LARGEST_ARRAYS, read_whole
from anchorpose.sources.grey_images import ImageFiles
from anchorpose.sources.image_folder import image_array
from anchorpose.sources.source import Reader

HEADER_BYTES: Final = 128
_ORDER_AT: Final = slice(126, 128)  # bytes of the header that state the byte order
_INT8, _INT32, _UINT32, _MATRIX, _COMPRESSED = 1, 5, 6, 14, 15
_STORED: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Types in which numbers are stored, by code; MATLAB stores an array in the smallest type that holds its values."""

_CLASSES: Final = {6: "f8", 7: "f4", 11: "u2"}
"""Classes of arrays that can be depth, by their codes: double, single and uint16."""

_COMPLEX: Final = 0x800  # flag of an array of complex numbers
_HEAD_BYTES: Final = 4096  # number of bytes at the beginning of a compressed array that hold its class, shape and name


@dataclass(frozen=True, slots=True, eq=False)
class MatArray:
    """An array whose values have not been read yet. dtype: type of its values; order: byte order of the file; content:
    the array's bytes in the file, compressed or uncompressed.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[np.generic]
    order: str
    content: memoryview
    compressed: bool

    @property
    def size_bytes(self) -> int:
        """Return the size of the values in memory in bytes."""
        return math.prod(self.shape) * self.dtype.itemsize

    def read(self) -> np.ndarray:
        """Read the values; raises ValueError or zlib.error if the array's bytes are damaged."""
        matrix = self.content
        if self.compressed:
            unpack = zlib.decompressobj()
            most = 8 * math.prod(self.shape) + 2 * _HEAD_BYTES
            matrix = _body(memoryview(unpack.decompress(self.content, most)), self.order)
            if not unpack.eof:
                raise ValueError("more values than its shape has")
        kind, values = next(islice(_elements(matrix, self.order), 3, None))
        stored = np.frombuffer(values, f"{self.order}{_STORED[kind]}")
        return stored.reshape(self.shape, order="F").astype(self.dtype)


def list_arrays(data: memoryview) -> list[MatArray]:
    """List the arrays of a file that can be depth images, in the file's order; raises ValueError, LookupError,
    struct.error or zlib.error if the file is damaged or cut off.
    """
    order = {b"IM": "<", b"MI": ">"}[bytes(data[_ORDER_AT])]
    found = list[MatArray]()
    for kind, content in _elements(data[HEADER_BYTES:], order):
        matrix = content
        if kind == _COMPRESSED:
            matrix = _body(memoryview(zlib.decompressobj().decompress(content, _HEAD_BYTES)), order)
        elif kind != _MATRIX:
            raise ValueError("an element that is not an array")
        (flags, shape, name) = islice(_elements(matrix, order), 3)
        if (flags[0], shape[0], name[0], len(flags[1])) != (_UINT32, _INT32, _INT8, 8):
            raise ValueError("an array without class, shape and name")
        (flag,) = struct.unpack_from(f"{order}I", flags[1])
        sides = tuple(np.frombuffer(shape[1], f"{order}i4").tolist())
        if flag & 0xFF in _CLASSES and not flag & _COMPLEX and min(sides, default=0) > 0:
            dtype = np.dtype(_CLASSES[flag & 0xFF])
            found.append(MatArray(str(name[1], "latin-1"), sides, dtype, order, content, kind == _COMPRESSED))
    return found


def _body(data: memoryview, order: str) -> memoryview:
    """Return the content of an array's element, without its tag (type and size). data: the element after unpacking, or
    only its beginning.
    """
    if len(data) < 8 or struct.unpack_from(f"{order}I", data) != (_MATRIX,):
        raise ValueError("a compressed element that is not an array")
    return data[8:]


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield type and content of each element in ``data``; raises ValueError if an element ends beyond ``data``."""
    place = 0
    while place < len(data):
        kind, size = struct.unpack_from(f"{order}II", data, place)
        start = place + 8
        if kind >> 16:  # a small element has size and type in four bytes, the content in the next four
            kind, size, start = kind & 0xFFFF, kind >> 16, place + 4
        if start + size > len(data):
            raise ValueError("an element that ends beyond the file")
        yield kind, data[start : start + size]
        place = start + size
        if kind != _COMPRESSED:
            place += -place % 8


def _open_mat(path: Path) -> ImageFiles:
    """Open a MATLAB file, which cannot be read in part: the whole array is held in memory.

    Raises InputError if the file is damaged or cut off, or does not have exactly one array that could be depth.
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
    height, width, count = images.shape
    return image_array(path, (count, height, width), images.dtype, lambda position: images[:, :, position])


READERS: Final = (Reader(lambda _, head: head.startswith(b"MATLAB 5.0"), _open_mat),)
