"""Reading triangle meshes from PLY files: ascii and binary, polygons split into triangles."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError

_TYPES: Final = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_REMEDY: Final = "export the mesh again as PLY with vertices x y z in metres and triangular faces"


@dataclass(frozen=True, slots=True)
class _Property:
    name: str
    type: str
    count_type: str | None  # of a list property; None for a single value


@dataclass(frozen=True, slots=True)
class _Element:
    name: str
    count: int
    properties: tuple[_Property, ...]


def read_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) float64 and faces (f, 3) int32 of a PLY file.

    Raises InputError where the file cannot be read, is cut short, or a face names a vertex that is not there.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "check the path of the mesh") from None
    try:
        order, elements, start = _parse_header(data)
        vertices, polygons = _parse_body(data[start:], order, elements)
    except (ValueError, IndexError, KeyError, UnicodeDecodeError) as error:
        raise InputError(path, f"is no usable PLY mesh ({error})", _REMEDY) from None
    faces = [(p[0], p[i], p[i + 1]) for p in polygons for i in range(1, len(p) - 1)]
    if not faces or not np.isfinite(vertices).all():
        raise InputError(path, "has no faces or a vertex that is not finite", _REMEDY)
    triangles = np.array(faces, dtype=np.int64)
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise InputError(path, f"a face names a vertex outside 0 to {len(vertices) - 1}", _REMEDY)
    return vertices, triangles.astype(np.int32)


def _parse_header(data: bytes) -> tuple[str, list[_Element], int]:
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise ValueError("it has no PLY header")
    order, elements = None, list[_Element]()
    for line in data[:end].decode("ascii").splitlines()[1:]:
        words = line.split()
        match words:
            case ["format", name, _]:
                order = _ORDERS[name]
            case ["element", name, count]:
                elements.append(_Element(name, int(count), ()))
            case ["property", "list", count_type, item_type, name]:
                _append(elements, _Property(name, _TYPES[item_type], _TYPES[count_type]))
            case ["property", item_type, name]:
                _append(elements, _Property(name, _TYPES[item_type], None))
    if order is None:
        raise ValueError("its header names no format")
    return order, elements, data.index(b"\n", end) + 1


def _append(elements: list[_Element], new: _Property) -> None:
    last = elements[-1]
    elements[-1] = _Element(last.name, last.count, (*last.properties, new))


def _parse_body(body: bytes, order: str, elements: list[_Element]) -> tuple[np.ndarray, list[list[int]]]:
    read = _AsciiReader(body.split()) if order == "" else _BinaryReader(body, order)
    vertices, polygons = None, list[list[int]]()
    for element in elements:
        rows = [{p.name: read.value(p) for p in element.properties} for _ in range(element.count)]
        if element.name == "vertex":
            vertices = np.array([[row[axis][0] for axis in "xyz"] for row in rows], dtype=np.float64).reshape(-1, 3)
        if element.name == "face":
            polygons = [[int(i) for i in row.get("vertex_indices", row.get("vertex_index", []))] for row in rows]
    if vertices is None:
        raise ValueError("it has no vertices")
    return vertices, polygons


class _AsciiReader:
    def __init__(self, words: list[bytes]) -> None:
        self._words, self._next = words, 0

    def value(self, wanted: _Property) -> list[float]:
        count = 1 if wanted.count_type is None else int(self._take(1)[0])
        return self._take(count)

    def _take(self, count: int) -> list[float]:
        words = self._words[self._next : self._next + count]
        if count < 0 or len(words) < count:
            raise ValueError("it is cut short")
        self._next += count
        return [float(word) for word in words]


class _BinaryReader:
    def __init__(self, body: bytes, order: str) -> None:
        self._body, self._order, self._next = body, order, 0

    def value(self, wanted: _Property) -> list[float]:
        count = 1 if wanted.count_type is None else int(self._take(wanted.count_type, 1)[0])
        return self._take(wanted.type, count)

    def _take(self, type_name: str, count: int) -> list[float]:
        dtype = np.dtype(self._order + type_name)
        end = self._next + count * dtype.itemsize
        if count < 0 or end > len(self._body):
            raise ValueError("it is cut short")
        values = np.frombuffer(self._body, dtype, count, self._next)
        self._next = end
        return values.tolist()
