"""Reading and writing equipment.json, the format ``equipment-model``.

Reading triangle meshes from PLY files: ascii and binary, polygons split into triangles.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.document import JsonObject, check_format, read_json_object
from anchorpose.recording.equipment import Box, Cylinder, EquipmentModel, EquipmentPart, Mesh

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


LARGEST_M: Final = 20.0
"""Equipment fits into a room; anything larger was written in millimetres."""

ROTATION_TOLERANCE: Final = 5e-4
"""Largest entry of R^T R - I that rounding to four decimals explains; more is a scale, a shear or a mistake."""


def read_equipment(path: Path) -> EquipmentModel:
    """The model chi_0 in an equipment.json; raises InputError naming the file, the key and the remedy."""
    top = read_json_object(path)
    top.only("format", "version", "parts")
    check_format(top, "equipment-model")
    parts = tuple(_parse_part(part) for part in top.objects("parts"))
    if not parts:
        raise top.refuse("parts", "is empty", 'list at least one part or write "equipment": null in recording.json')
    names = [part.name for part in parts]
    for name in names:
        if names.count(name) > 1:
            raise top.refuse("parts", f"has two parts named '{name}'", "give each part its own name")
    return EquipmentModel(parts)


def write_equipment(path: Path, equipment: EquipmentModel) -> None:
    """Writes boxes and cylinders as an equipment.json; raises TypeError on a mesh, which is a file of its own."""
    document = {"format": "equipment-model", "version": 1, "parts": [_part_entry(part) for part in equipment.parts]}
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def is_rotation(matrix: np.ndarray) -> bool:
    """Whether a (3, 3) matrix is a proper rotation within ``ROTATION_TOLERANCE``."""
    orthonormal = np.abs(matrix.T @ matrix - np.eye(3)).max() <= ROTATION_TOLERANCE
    return bool(orthonormal and np.linalg.det(matrix) > 0)


def check_relative(where: JsonObject, key: str) -> str:
    """A file name inside the recording folder; raises InputError for a path that leads out of it."""
    name = where.text(key)
    path = PurePosixPath(name.replace("\\", "/"))
    if path.is_absolute() or ".." in path.parts or ":" in name:
        raise where.refuse(key, f"leads out of the recording folder ('{name}')", "put the file into the folder")
    return name


def _parse_part(part: JsonObject) -> EquipmentPart:
    match part.text("shape"):
        case "box":
            return _parse_box(part)
        case "cylinder":
            return _parse_cylinder(part)
        case "mesh":
            return _parse_mesh(part)
        case other:
            raise part.refuse("shape", f"is '{other}'", "it must be box, cylinder or mesh")


def _part_entry(part: EquipmentPart) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": part.name, "shape": type(part).__name__.lower()}
    match part:
        case Box():
            lengths = {"size": part.size_m.tolist(), "rotation": part.rotation.tolist()}
        case Cylinder():
            lengths = {"radius": float(part.radius_m), "length": float(part.length_m), "axis": part.axis.tolist()}
        case _:
            raise TypeError(f"{part.name} is a mesh; only boxes and cylinders are written")
    return {**entry, "center": part.center_m.tolist(), **lengths}


def _parse_box(part: JsonObject) -> Box:
    part.only("name", "shape", "center", "size", "rotation")
    size = part.numbers("size", (3,), "the three edge lengths in metres")
    if size.min() <= 0 or size.max() > LARGEST_M:
        raise part.refuse("size", f"is {size.tolist()}", f"edge lengths are metres, above 0 and up to {LARGEST_M:g}")
    rotation = np.eye(3)  # the format's meaning of no rotation: edges along the axes of Gamma_0
    if part.has("rotation"):
        rotation = part.numbers("rotation", (3, 3), "a rotation matrix, three rows of three numbers")
        if not is_rotation(rotation):
            raise part.refuse("rotation", "is no rotation", "its columns must be unit, at right angles, right-handed")
    return Box(part.text("name"), _center(part), size, rotation)


def _parse_cylinder(part: JsonObject) -> Cylinder:
    part.only("name", "shape", "center", "radius", "length", "axis")
    axis = part.numbers("axis", (3,), "the direction of the cylinder's axis")
    length = np.linalg.norm(axis)
    if not length > 1e-6:
        raise part.refuse("axis", "has no direction", "write the direction of the axis, for example [0, 1, 0]")
    return Cylinder(
        part.text("name"),
        _center(part),
        axis / length,
        part.number("radius", above=0, at_most=LARGEST_M, meaning="the radius in metres"),
        part.number("length", above=0, at_most=LARGEST_M, meaning="the length in metres"),
    )


def _parse_mesh(part: JsonObject) -> Mesh:
    part.only("name", "shape", "file")
    path = part.path.parent / check_relative(part, "file")
    vertices, faces = read_ply(path)
    if np.abs(vertices).max() > LARGEST_M:
        raise part.refuse("file", f"reaches {np.abs(vertices).max():.0f} m from the origin", "save the mesh in metres")
    return Mesh(part.text("name"), vertices, faces)


def _center(part: JsonObject) -> np.ndarray:
    center = part.numbers("center", (3,), "the centre in metres, three numbers")
    if np.abs(center).max() > LARGEST_M:
        raise part.refuse("center", f"is {center.tolist()}", f"metres are meant, up to {LARGEST_M:g} from the origin")
    return center
