"""model.osim: the patient's skeleton for OpenSim 4, written as XML so that exporting it does not need OpenSim."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final
from xml.etree import ElementTree

import numpy as np

from anchorpose import __version__
from anchorpose.exports.formats import CoordinateModel
from anchorpose.exports.osim_segments import MASS_SHARE, MeasuredBody, OsimBody, OsimCoordinate, segments

OSIM_VERSION: Final = "40000"  # of the file format; every OpenSim 4 reads it
NOMINAL_MASS_KG: Final = 75.0
"""An adult's: the patient's is unknown, OpenSim needs one to load the model, and kinematics do not use it."""

ROD_RADIUS_M: Final = 0.012
_AXES: Final = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def model_xml(body: MeasuredBody, model: CoordinateModel) -> str:
    """The document; bodies stand upright with arms down where all coordinates are zero."""
    document = ElementTree.Element("OpenSimDocument", Version=OSIM_VERSION)
    root = _add(document, "Model", name="anchorpose")
    _add(root, "credits", f"anchorpose {__version__}: joint centres of one recording. Research use only.")
    _add(root, "length_units", "meters")
    _add(root, "force_units", "N")
    _add(root, "gravity", "0 -9.80665 0")
    _add(root, "Ground", name="ground")
    parts = segments(body, model)
    _set(root, "BodySet", "bodyset", (_body(part) for part in parts))
    _set(root, "JointSet", "jointset", (_joint(part) for part in parts))
    _set(root, "MarkerSet", "markerset", (_marker(part, *marker) for part in parts for marker in part.markers))
    return as_text(document)


def as_text(document: ElementTree.Element) -> str:
    """An indented XML file."""
    ElementTree.indent(document, "\t")
    return f'<?xml version="1.0" encoding="UTF-8" ?>\n{ElementTree.tostring(document, encoding="unicode")}\n'


def _body(part: OsimBody) -> ElementTree.Element:
    mass = MASS_SHARE[part.kind] * NOMINAL_MASS_KG
    ends = np.array(part.rods)
    length = float(np.linalg.norm(ends[0, 1] - ends[0, 0]))
    centre = ends[0].mean(axis=0)
    across, along = mass * (length**2 / 12.0 + 0.05**2 / 4.0), mass * 0.05**2 / 2.0  # a rod of 5 cm radius
    body = ElementTree.Element("Body", name=part.name)
    _add(body, "mass", _numbers([mass]))
    _add(body, "mass_center", _numbers(centre))
    _add(body, "inertia", _numbers([across, along, across, 0.0, 0.0, 0.0]))
    components = _add(body, "components")
    for number, (start, end) in enumerate(part.rods):
        components.append(_rod(f"{part.name}_rod{number}", start, end))
    return body


def _rod(name: str, start: np.ndarray, end: np.ndarray) -> ElementTree.Element:
    """A cylinder from point to point; OpenSim's cylinder is along Y."""
    along = end - start
    length = float(np.linalg.norm(along))
    frame = ElementTree.Element("PhysicalOffsetFrame", name=name)
    geometry = _add(frame, "attached_geometry")
    cylinder = _add(geometry, "Cylinder", name=f"{name}_shape")
    _add(cylinder, "radius", _numbers([ROD_RADIUS_M]))
    _add(cylinder, "half_height", _numbers([length / 2.0]))
    _add(frame, "socket_parent", "..")
    _add(frame, "translation", _numbers((start + end) / 2.0))
    # body-fixed X then Z (OpenSim's X-Y-Z without a rotation about Y) that bring Y along the rod
    along = along / length if length else np.array(_AXES[1])
    about_z = np.arcsin(np.clip(-along[0], -1.0, 1.0))
    _add(frame, "orientation", _numbers([np.arctan2(along[2], along[1]), 0.0, about_z]))
    return frame


def _joint(part: OsimBody) -> ElementTree.Element:
    joint = ElementTree.Element("CustomJoint", name=part.joint)
    _add(joint, "socket_parent_frame", f"{part.joint}_in_parent")
    _add(joint, "socket_child_frame", f"{part.joint}_in_child")
    coordinates = _add(joint, "coordinates")
    for coordinate in part.coordinates:
        coordinates.append(_coordinate(coordinate))
    frames = _add(joint, "frames")
    for where, owner, place in (
        ("parent", part.parent, part.place_m),
        ("child", f"/bodyset/{part.name}", np.zeros(3)),
    ):
        frame = _add(frames, "PhysicalOffsetFrame", name=f"{part.joint}_in_{where}")
        _add(frame, "socket_parent", owner)
        _add(frame, "translation", _numbers(place))
        _add(frame, "orientation", "0 0 0")
    joint.append(_transform(part.coordinates))
    return joint


def _coordinate(coordinate: OsimCoordinate) -> ElementTree.Element:
    element = ElementTree.Element("Coordinate", name=coordinate.name)
    _add(element, "default_value", _numbers([coordinate.default]))
    _add(element, "range", _numbers(coordinate.range))
    _add(element, "clamped", "true")
    return element


def _transform(coordinates: tuple[OsimCoordinate, ...]) -> ElementTree.Element:
    """Six axes: three rotations, then three translations; those without a coordinate are constant."""
    transform = ElementTree.Element("SpatialTransform")
    for kind, moves in (("rotation", False), ("translation", True)):
        used = [coordinate for coordinate in coordinates if coordinate.moves is moves]
        axes = [coordinate.axis for coordinate in used]
        spare = [axis for axis in _AXES if not any(abs(np.dot(axis, other)) > 0.5 for other in axes)]
        for number, axis in enumerate([*axes, *spare], 1):
            element = _add(transform, "TransformAxis", name=f"{kind}{number}")
            _add(element, "coordinates", used[number - 1].name if number <= len(used) else "")
            _add(element, "axis", _numbers(axis))
            if number <= len(used):
                _add(_add(element, "LinearFunction", name="function"), "coefficients", "1 0")
            else:
                _add(_add(element, "Constant", name="function"), "value", "0")
    return transform


def _marker(part: OsimBody, name: str, place_m: np.ndarray) -> ElementTree.Element:
    marker = ElementTree.Element("Marker", name=name)
    _add(marker, "socket_parent_frame", f"/bodyset/{part.name}")
    _add(marker, "location", _numbers(place_m))
    _add(marker, "fixed", "true")
    return marker


def _set(parent: ElementTree.Element, tag: str, name: str, elements: Iterable[ElementTree.Element]) -> None:
    objects = _add(_add(parent, tag, name=name), "objects")
    objects.extend(elements)


def _add(parent: ElementTree.Element, tag: str, text: str | None = None, **attributes: str) -> ElementTree.Element:
    element = ElementTree.SubElement(parent, tag, attributes)
    element.text = text
    return element


def _numbers(values: Iterable[float] | np.ndarray) -> str:
    return " ".join(f"{float(value):.6g}" for value in values)
