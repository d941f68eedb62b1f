"""Read the model of the equipment (chi_0 in Section III of the paper): boxes, cylinders and meshes in the equipment's
own coordinate frame (Gamma_0).

The model is stored in equipment.json (format ``equipment-model``) and in the PLY meshes that this file names.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numba
import numpy as np
from pydantic import AfterValidator, Field, model_validator

from anchorpose.errors import InputError
from anchorpose.recording.document import Entry, FileInFolder, Text, Version, is_rotation, numbers, read_document
from anchorpose.recording.regular_file import read_whole
from anchorpose.recording.writable import whole_file
from anchorpose.settings import Unfit

CYLINDER_SIDES: Final = 32
"""Number of sides of the prism that represents a cylinder. The prism differs from the cylinder by half a per cent of
the radius, less than a depth camera resolves.
"""

_BOX_CORNERS: Final = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_FACES: Final = "013 032 467 475 045 051 237 276 026 064 157 173"  # indices of the corners of each triangle of a box
_BOX_FACES: Final = np.array([[*map(int, face)] for face in _FACES.split()], dtype=np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A cuboid: all points ``center_m + rotation @ local`` with |local| <= size_m / 2 on each axis."""

    name: str
    center_m: np.ndarray  # (3,)
    size_m: np.ndarray  # (3,) full edge lengths
    rotation: np.ndarray  # (3, 3)

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices (8, 3) float64 and faces (12, 3) int32, counter-clockwise seen from outside."""
        return self.center_m + (_BOX_CORNERS * self.size_m) @ self.rotation.T, _BOX_FACES

    def distance_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return the exact signed distance (n,) to the surface; negative inside."""
        beyond = np.abs((points_m - self.center_m) @ self.rotation) - self.size_m / 2.0
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(beyond.max(axis=-1), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Cylinder:
    """A solid cylinder with flat ends; ``center_m`` is the middle of its axis."""

    name: str
    center_m: np.ndarray  # (3,)
    axis: np.ndarray  # (3,) unit
    radius_m: float
    length_m: float

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices (2 s + 2, 3) float64 and faces (4 s, 3) int32 of a prism, s = ``CYLINDER_SIDES``."""
        sideways = np.eye(3)[np.argmin(np.abs(self.axis))]
        u = np.cross(self.axis, sideways)
        u /= np.linalg.norm(u)
        v = np.cross(self.axis, u)
        angle = 2.0 * np.pi * np.arange(CYLINDER_SIDES) / CYLINDER_SIDES
        rim = self.radius_m * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v)
        half = self.axis * self.length_m / 2.0
        vertices = self.center_m + np.concatenate([rim - half, rim + half, [-half, half]])
        low, after = np.arange(CYLINDER_SIDES), (np.arange(CYLINDER_SIDES) + 1) % CYLINDER_SIDES
        high, high_after = low + CYLINDER_SIDES, after + CYLINDER_SIDES
        bottom, top = np.full_like(low, 2 * CYLINDER_SIDES), np.full_like(low, 2 * CYLINDER_SIDES + 1)
        rings = [(low, after, high_after), (low, high_after, high), (bottom, after, low), (top, high, high_after)]
        return vertices, np.concatenate([np.stack(ring, axis=1) for ring in rings]).astype(np.int32)

    def distance_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return the exact signed distance (n,) to the surface; negative inside."""
        offset = points_m - self.center_m
        along = offset @ self.axis
        across = np.linalg.norm(offset - along[..., None] * self.axis, axis=-1)
        beyond = np.stack([across - self.radius_m, np.abs(along) - self.length_m / 2.0], axis=-1)
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(beyond.max(axis=-1), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of any shape; they need not enclose a volume."""

    name: str
    vertices_m: np.ndarray  # (v, 3) float64
    faces: np.ndarray  # (f, 3) int32

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices (v, 3) float64 and faces (f, 3) int32."""
        return self.vertices_m, self.faces

    def distance_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return the exact distance (n,) to the nearest triangle; never negative."""
        return mesh_distance_m(points_m, self.vertices_m, self.faces)


EquipmentPart = Box | Cylinder | Mesh


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentModel:
    """All parts of the equipment, in its own frame Gamma_0 (ISB axes: X forward, Y up, Z right; metres)."""

    parts: tuple[EquipmentPart, ...]

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return all parts as one mesh: vertices (v, 3) float64 and faces (f, 3) int32."""
        vertices, faces, count = [], [], 0
        for part in self.parts:
            part_vertices, part_faces = part.triangles()
            vertices.append(part_vertices)
            faces.append(part_faces + count)
            count += len(part_vertices)
        return np.concatenate(vertices), np.concatenate(faces).astype(np.int32)

    def distance_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return the exact distance (n,) float64 of points (n, 3) to the surface of the nearest part.

        Points are in the equipment's frame. The distance is negative inside a box or a cylinder. For a mesh, which has
        no inside, it is never negative. The distance is NaN where a point is NaN.
        """
        points = np.asarray(points_m, dtype=np.float64)
        return np.min([part.distance_m(points) for part in self.parts], axis=0)


def mesh_distance_m(points_m: np.ndarray, vertices_m: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return (n,) float64 distance of each point (n, 3) to the nearest triangle; never negative, since a mesh need not
    be closed.

    vertices_m (v, 3); faces (f, 3): indices of vertices. The distance is NaN where a point is NaN. Source: closest
    point on a triangle, Ericson, Real-Time Collision Detection (2005), Section 5.1.5. A triangle is skipped if the
    sphere around it is farther than the nearest triangle so far.
    """
    corners = np.ascontiguousarray(vertices_m[faces], dtype=np.float64)
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    points = np.ascontiguousarray(points_m, dtype=np.float64)
    return _nearest(points, corners, centres, radii)


@numba.njit(cache=True)
def _nearest(points: np.ndarray, corners: np.ndarray, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    distances = np.empty(len(points))
    for i in range(len(points)):
        best = np.inf
        for f in range(len(corners)):
            if np.sqrt(np.sum((points[i] - centres[f]) ** 2)) - radii[f] < best:
                best = min(best, _to_triangle(points[i], corners[f, 0], corners[f, 1], corners[f, 2]))
        distances[i] = best if np.isfinite(points[i].sum()) else np.nan
    return distances


@numba.njit(cache=True)
def _to_triangle(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    ab, ac, ap, bp, cp = b - a, c - a, p - a, p - b, p - c
    d1, d2 = np.sum(ab * ap), np.sum(ac * ap)
    d3, d4 = np.sum(ab * bp), np.sum(ac * bp)
    d5, d6 = np.sum(ab * cp), np.sum(ac * cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0 and d2 <= 0:
        v, w = 0.0, 0.0  # corner a
    elif d3 >= 0 and d4 <= d3:
        v, w = 1.0, 0.0  # corner b
    elif d6 >= 0 and d5 <= d6:
        v, w = 0.0, 1.0  # corner c
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        v, w = d1 / (d1 - d3), 0.0  # edge ab
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        v, w = 0.0, d2 / (d2 - d6)  # edge ac
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))  # edge bc
        v = 1.0 - w
    else:
        total = va + vb + vc
        v, w = vb / total, vc / total
    return np.sqrt(np.sum((ap - v * ab - w * ac) ** 2))


SMALLEST_M, LARGEST_M = 1e-4, 20.0
"""Minimum and maximum of a length in m: the thickness of sheet metal, and the size of a room, into which equipment
fits. A larger value was probably written in millimetres.
"""

MOST_PARTS: Final = 1000
MOST_PLY_BYTES, MOST_ELEMENTS = 64 << 20, 500_000
"""Maximum size of a mesh file in bytes, and maximum number of its vertices and of its faces. A scan with millimetre
detail reaches these limits; tracking needs a hundredth of this size.
"""


def _require_rotation(matrix: np.ndarray) -> np.ndarray:
    if not is_rotation(matrix):
        raise Unfit("is not a rotation", "its columns must be unit vectors, at right angles, right-handed")
    return matrix


def _unit(axis: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(axis)
    if not length > 1e-6:
        raise Unfit("has no direction", "write the direction of the axis, for example [0, 1, 0]")
    return np.asarray(axis / length)


_Coordinate = Annotated[float, Field(ge=-LARGEST_M, le=LARGEST_M, description="metres from the origin of Gamma_0")]
_Length = Annotated[float, Field(ge=SMALLEST_M, le=LARGEST_M, description="a length in metres")]
_Rotation = Annotated[np.ndarray, numbers(3, 3, meaning="three rows of three"), AfterValidator(_require_rotation)]
_Axis = Annotated[np.ndarray, numbers(3, meaning="the direction of the cylinder's axis"), AfterValidator(_unit)]


class PartEntry(Entry):
    name: Text
    center: tuple[_Coordinate, _Coordinate, _Coordinate]


class BoxEntry(PartEntry):
    shape: Literal["box"]
    size: tuple[_Length, _Length, _Length]
    rotation: _Rotation | None = None  # None: edges along the axes of the equipment's frame


class CylinderEntry(PartEntry):
    shape: Literal["cylinder"]
    radius: _Length
    length: _Length
    axis: _Axis


class MeshEntry(Entry):
    name: Text
    shape: Literal["mesh"]
    file: FileInFolder


class EquipmentDocument(Entry):
    """The content of equipment.json, before the files of its meshes are read."""

    format: Literal["equipment-model"]
    version: Version
    parts: tuple[Annotated[BoxEntry | CylinderEntry | MeshEntry, Field(discriminator="shape")], ...]

    @model_validator(mode="after")
    def _require_named_parts(self) -> EquipmentDocument:
        names = [part.name for part in self.parts]
        if not names:
            raise Unfit("is empty", 'list at least one part or write "equipment": null in recording.json', "parts")
        for name, count in Counter(names).items():
            if count > 1:
                raise Unfit(f"has two parts named '{name}'", "give each part its own name", "parts")
        if len(names) > MOST_PARTS:
            raise Unfit(f"has {len(names)} parts", f"list {MOST_PARTS} at most, or make a mesh of them", "parts")
        return self


def read_equipment(path: Path) -> EquipmentModel:
    """Read the equipment's model from an equipment.json; raises InputError naming the file, the key and the remedy."""
    document = read_document(path, EquipmentDocument)
    return EquipmentModel(tuple(_part(path, f"parts[{i}]", entry) for i, entry in enumerate(document.parts)))


def equipment_files(path: Path) -> tuple[Path, ...]:
    """Return the equipment.json at ``path`` and the meshes that it names."""
    parts = read_document(path, EquipmentDocument).parts
    return path, *(path.parent / part.file for part in parts if isinstance(part, MeshEntry))


def write_equipment(path: Path, equipment: EquipmentModel) -> None:
    """Write boxes and cylinders as an equipment.json; raises TypeError for a mesh, which would need another file."""
    document = {"format": "equipment-model", "version": 1, "parts": [_part_entry(part) for part in equipment.parts]}
    with whole_file(path) as partial:
        partial.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _part(path: Path, place: str, entry: BoxEntry | CylinderEntry | MeshEntry) -> EquipmentPart:
    match entry:
        case BoxEntry():
            rotation = np.eye(3) if entry.rotation is None else entry.rotation
            return Box(entry.name, np.array(entry.center), np.array(entry.size), rotation)
        case CylinderEntry():
            return Cylinder(entry.name, np.array(entry.center), entry.axis, entry.radius, entry.length)
    vertices_m, faces = read_ply(path.parent / entry.file)
    farthest_m = np.abs(vertices_m).max()
    if farthest_m > LARGEST_M:
        raise InputError(path, f"{place}.file reaches {farthest_m:.0f} m from the origin", "save the mesh in metres")
    return Mesh(entry.name, vertices_m, faces)


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


_NAMES: Final = "char uchar short ushort int uint float double int8 uint8 int16 uint16 int32 uint32 float32 float64"
_TYPES: Final = dict(zip(_NAMES.split(), 2 * ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"), strict=True))
_ORDERS: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_REMEDY: Final = "export the mesh again as PLY with vertices x y z in metres and triangular faces"


_Property = tuple[str, str, str | None]  # name, type of the values, type of a list's length (None if not a list)
_Element = tuple[str, int, list[_Property]]  # name, count, properties


def read_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read vertices (v, 3) float64 and faces (f, 3) int32 of a PLY file.

    Raises InputError if the file cannot be read, is cut short, or a face refers to a vertex that does not exist.
    """
    data = read_whole(path, MOST_PLY_BYTES, "check the path of the mesh")
    try:
        vertices, polygons = _parse(data)
        faces = [(p[0], p[i], p[i + 1]) for p in polygons for i in range(1, len(p) - 1)]
        triangles = np.array(faces, dtype=np.int64)
    except (ValueError, IndexError, KeyError, OverflowError) as error:
        raise InputError(path, f"is not a usable PLY mesh ({error})", _REMEDY) from None
    if not faces or not np.isfinite(vertices).all():
        raise InputError(path, "has no faces or a vertex that is not finite", _REMEDY)
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise InputError(path, f"a face names a vertex outside 0 to {len(vertices) - 1}", _REMEDY)
    return vertices, triangles.astype(np.int32)


def _parse(data: bytes) -> tuple[np.ndarray, list[list[int]]]:
    """Return vertices (v, 3) and polygons (indices); bad data raise ValueError, LookupError or OverflowError."""
    head, mark, rest = data.partition(b"end_header")
    if not head.startswith(b"ply") or not mark:
        raise ValueError("it has no PLY header")
    order, elements, body = None, list[_Element](), rest.split(b"\n", 1)[1]
    for line in head.decode("ascii").splitlines()[1:]:
        match line.split():
            case ["format", name, _]:
                order = _ORDERS[name]
            case ["element", name, size]:
                elements.append((name, int(size), []))
            case ["property", "list", count_type, item_type, name]:
                elements[-1][2].append((name, _TYPES[item_type], _TYPES[count_type]))
            case ["property", item_type, name]:
                elements[-1][2].append((name, _TYPES[item_type], None))
    if order is None:
        raise ValueError("its header names no format")
    take = _value_reader(body, order)
    vertices, polygons = None, list[list[int]]()
    for name, count, properties in elements:
        if count > len(body) or not properties:
            raise ValueError("it is cut short")
        if count > MOST_ELEMENTS:
            raise ValueError(f"it has {count:,} of {name}, more than {MOST_ELEMENTS:,}")
        rows = [
            {key: take(kind, 1 if length is None else int(take(length, 1)[0])) for key, kind, length in properties}
            for _ in range(count)
        ]
        if name == "vertex":
            vertices = np.array([[row[axis][0] for axis in "xyz"] for row in rows], dtype=np.float64).reshape(-1, 3)
        if name == "face":
            polygons = [[int(i) for i in row.get("vertex_indices", row.get("vertex_index", []))] for row in rows]
    if vertices is None:
        raise ValueError("it has no vertices")
    return vertices, polygons


def _value_reader(body: bytes, order: str) -> Callable[[str, int], list[float]]:
    """Return a function that gets a type and a count, and reads this number of values of this type: from binary data in
    the byte order ``order``, or from words of text if ``order`` is empty.
    """
    words, place = [] if order else body.split(), 0

    def take(kind: str, count: int) -> list[float]:
        nonlocal place
        dtype = np.dtype(order + kind)
        start, place = place, place + count * (dtype.itemsize if order else 1)
        if count < 0 or place > len(body if order else words):
            raise ValueError("it is cut short")
        if order:
            return [float(value) for value in np.frombuffer(body, dtype, count, start).tolist()]
        return [float(word) for word in words[start:place]]

    return take
