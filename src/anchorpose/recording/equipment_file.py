"""Reading and writing equipment.json, the format ``equipment-model``."""

from __future__ import annotations

import json
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np

from anchorpose.recording.document import JsonObject, check_format, read_json_object
from anchorpose.recording.equipment import Box, Cylinder, EquipmentModel, EquipmentPart, Mesh
from anchorpose.recording.ply import read_ply

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
