"""Write model.osim for OpenSim 4: the patient's bodies (segments), joints and markers, measured over all frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree

import numpy as np

from anchorpose import __version__
from anchorpose.exports.opensim_coordinates import SIDES, in_axes, joint, known_median, pelvis_axes, torso_axes
from anchorpose.options import CoordinateModel
from anchorpose.results.joint_angles import SOLE_SLOPE_DEG

Places = Mapping[str, np.ndarray]
"""Positions of the joints by name: each (3,), metres, relative to the origin of the OpenSim body that carries the
joint, in this body's axes, while the limbs hang straight down.
"""

_IN_TRUNK: Final = {
    "SpineMid": ("pelvis", "SpineBase"),
    "SpineShoulder": ("torso", "SpineMid"),
    "Neck": ("torso", "SpineMid"),
    "Head": ("torso", "Neck"),
    **{f"Hip{side}": ("pelvis", "SpineBase") for side, _, _ in SIDES},
    **{f"Shoulder{side}": ("torso", "SpineMid") for side, _, _ in SIDES},
}
_LIMBS: Final = {
    "Knee": "Hip",
    "Ankle": "Knee",
    "Foot": "Ankle",
    "Elbow": "Shoulder",
    "Wrist": "Elbow",
    "Hand": "Wrist",
}
"""For each joint of a limb: the joint at the other (upper) end of the bone above it."""


def measure_body(position_m: np.ndarray) -> Places | None:
    """Return each joint's position in the OpenSim body that carries the joint, from medians over the frames of
    position_m (n, 21, 3); None if the two ends of a bone are never known in the same frame.
    """
    axes = {"pelvis": pelvis_axes(position_m), "torso": torso_axes(position_m)}

    def away(start: str, end: str) -> np.ndarray:
        return joint(position_m, end) - joint(position_m, start)

    found = {"SpineBase": np.zeros(3)}
    found |= {end: known_median(in_axes(axes[base], away(start, end))) for end, (base, start) in _IN_TRUNK.items()}
    for side, _, _ in SIDES:
        length = {
            end: float(known_median(np.linalg.norm(away(f"{start}{side}", f"{end}{side}"), axis=1, keepdims=True))[0])
            for end, start in _LIMBS.items()
        }
        slope, length["Hand"] = (
            np.radians(SOLE_SLOPE_DEG),
            length["Wrist"] + length["Hand"],
        )  # forearm and hand are a single body in the model
        found |= {f"{end}{side}": np.array([0.0, -length_m, 0.0]) for end, length_m in length.items()}
        found[f"Foot{side}"] = length["Foot"] * np.array([np.cos(slope), -np.sin(slope), 0.0])
    return found if all(np.isfinite(place).all() for place in found.values()) else None


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
Axis = tuple[float, float, float]

# Segment masses as shares of the body's mass (de Leva 1996, doi:10.1016/0021-9290(95)00178-6, for men). The pelvis is
# the lower trunk, the torso is the upper and middle trunk, and the ulna is forearm and hand.
MASS_SHARE: Final = {
    "pelvis": 0.1117,
    "torso": 0.3229,
    "head": 0.0694,
    "femur": 0.1416,
    "tibia": 0.0433,
    "calcn": 0.0137,
    "humerus": 0.0271,
    "ulna": 0.0223,
}


@dataclass(frozen=True, slots=True)
class OsimCoordinate:
    """A coordinate (degree of freedom) of an OpenSim joint, such as knee flexion: its axis in the parent body, its
    default value, and its range in radians or metres.
    """

    name: str
    axis: Axis
    range: tuple[float, float]
    default: float = 0.0
    moves: bool = False  # True: translation along the axis, False: rotation about it


@dataclass(frozen=True, slots=True, eq=False)
class OsimBody:
    """An OpenSim body (segment), the joint that connects it to its parent body, and the positions of the markers on it,
    each (3,) metres in the body's axes.
    """

    name: str
    parent: str
    joint: str
    place_m: np.ndarray  # position of the joint in the parent body's axes
    coordinates: tuple[OsimCoordinate, ...]
    markers: Places
    rods: tuple[tuple[np.ndarray, np.ndarray], ...]  # end points (3,) of each cylinder that is drawn


def segments(body: Places, model: CoordinateModel) -> tuple[OsimBody, ...]:
    """Return all OpenSim bodies, parents first. The bodies' coordinates have the names and signs of ``model``."""
    sided = [part for side in SIDES for part in (*_leg(body, *side, model), *_arm(body, *side))]
    return (_pelvis(body), *_trunk(body), *sided)


def _some(body: Places, *names: str) -> Places:
    """Return the positions of the markers at the joints ``names``, by joint."""
    return {name: body[name] for name in names}


WIDE: Final = (-4.0 * np.pi, 4.0 * np.pi)
"""Range in radians of all rotations except the rotations of hinges. The range is wider than any movement of a patient,
since OpenSim clamps a coordinate to its range, and OpenSim's inverse kinematics may stop at a limit.
"""

HINGE: Final = (np.radians(-30.0), np.pi)
"""Range in radians of the flexion of knees and elbows. Without a limit, a bent limb whose upper bone is rotated by half
a turn, with a joint bent backwards, would fit the markers as well. ``knee_flexion`` has the same limit: a bend of 30
degrees or more is flexion.
"""


def _pelvis(body: Places) -> OsimBody:
    turns = tuple(
        OsimCoordinate(f"pelvis_{name}", axis, WIDE) for name, axis in (("tilt", Z), ("list", X), ("rotation", Y))
    )
    moves = tuple(
        OsimCoordinate(f"pelvis_t{name}", axis, (-50.0, 50.0), 0.95 if name == "y" else 0.0, moves=True)
        for name, axis in (("x", X), ("y", Y), ("z", Z))
    )
    markers, base = _some(body, "SpineBase", "SpineMid", "HipRight", "HipLeft"), body["SpineBase"]
    rods = ((base, body["SpineMid"]), (body["HipRight"], body["HipLeft"]))
    return OsimBody("pelvis", "ground", "ground_pelvis", base, turns + moves, markers, rods)


def _trunk(body: Places) -> tuple[OsimBody, OsimBody]:
    zero = np.zeros(3)
    back, neck = (
        tuple(OsimCoordinate(f"{name}_{move}", axis, WIDE) for move, axis in moves)
        for name, moves in (
            ("lumbar", (("extension", Z), ("bending", X), ("rotation", Y))),
            ("neck", (("extension", Z), ("bending", X))),
        )
    )
    # the shoulder girdle moves on the chest, but the model has no joint for this movement, so the markers at the
    # shoulders belong to the arms
    top, markers = body["SpineShoulder"], _some(body, "SpineShoulder", "Neck")
    rods = ((zero, top), (top, body["Neck"]), (body["ShoulderRight"], body["ShoulderLeft"]))
    return (
        OsimBody("torso", "pelvis", "back", body["SpineMid"], back, markers, rods),
        OsimBody("head", "torso", "neck", body["Neck"], neck, _some(body, "Head"), ((zero, body["Head"]),)),
    )


def _leg(body: Places, side: str, end: str, sign: int, model: CoordinateModel) -> tuple[OsimBody, OsimBody, OsimBody]:
    zero, (back, bent) = np.zeros(3), HINGE
    axis, limits = (Z, (-bent, -back))
    if model is CoordinateModel.RAJAGOPAL:
        axis, limits = (0.0, 0.0, -1.0), HINGE
    hip = _ball(("hip_flexion", "hip_adduction", "hip_rotation"), end, sign)
    knee = OsimCoordinate(f"knee_angle_{end}", axis, limits)
    ankle = OsimCoordinate(f"ankle_angle_{end}", Z, WIDE)
    femur, tibia = f"femur_{end}", f"tibia_{end}"
    at_hip, at_knee, at_ankle, toe = (body[f"{name}{side}"] for name in ("Hip", "Knee", "Ankle", "Foot"))
    on_foot = {f"Ankle{side}": zero, f"Foot{side}": toe}
    return (
        OsimBody(femur, "pelvis", f"hip_{end}", at_hip, hip, {}, ((zero, at_knee),)),
        OsimBody(tibia, femur, f"walker_knee_{end}", at_knee, (knee,), {f"Knee{side}": zero}, ((zero, at_ankle),)),
        OsimBody(f"calcn_{end}", tibia, f"ankle_{end}", at_ankle, (ankle,), on_foot, ((zero, toe),)),
    )


def _arm(body: Places, side: str, end: str, sign: int) -> tuple[OsimBody, OsimBody]:
    zero, (shoulder, elbow, hand) = np.zeros(3), (body[f"{name}{side}"] for name in ("Shoulder", "Elbow", "Hand"))
    turns = _ball(("arm_flex", "arm_add", "arm_rot"), end, sign)
    bend = OsimCoordinate(f"elbow_flex_{end}", Z, HINGE)
    upper, on_forearm = f"humerus_{end}", {f"Elbow{side}": zero, **_some(body, f"Wrist{side}", f"Hand{side}")}
    return (
        OsimBody(upper, "torso", f"acromial_{end}", shoulder, turns, {f"Shoulder{side}": zero}, ((zero, elbow),)),
        OsimBody(f"ulna_{end}", upper, f"elbow_{end}", elbow, (bend,), on_forearm, ((zero, hand),)),
    )


def _ball(names: tuple[str, str, str], end: str, sign: int) -> tuple[OsimCoordinate, ...]:
    """Return a ball joint's coordinates: flexion, adduction and inward rotation, mirrored on the left."""
    axes: tuple[Axis, ...] = (Z, (float(sign), 0.0, 0.0), (0.0, float(sign), 0.0))
    return tuple(OsimCoordinate(f"{name}_{end}", axis, WIDE) for name, axis in zip(names, axes, strict=True))


OSIM_VERSION: Final = "40000"  # version of the file format; every OpenSim 4 reads it
NOMINAL_MASS_KG: Final = 75.0
"""Mass of an adult. OpenSim needs a mass to load the model. The patient's mass is unknown, but kinematics do not depend
on it.
"""

ROD_RADIUS_M: Final = 0.012  # radius of the cylinders that are drawn for the bodies


def xml(tag: str, *content: str | ElementTree.Element, **attributes: str) -> ElementTree.Element:
    """Return an XML element that contains a text or other elements."""
    element = ElementTree.Element(tag, attributes)
    for part in content:
        if isinstance(part, str):
            element.text = part
        else:
            element.append(part)
    return element


def xml_texts(**texts: str) -> list[ElementTree.Element]:
    """Return an XML element for each tag, which contains the tag's text."""
    return [xml(tag, text) for tag, text in texts.items()]


def xml_set(tag: str, name: str, elements: Iterable[ElementTree.Element]) -> ElementTree.Element:
    """Return the XML element of a named set of OpenSim's objects."""
    return xml(tag, xml("objects", *elements), name=name)


def document(root: ElementTree.Element) -> str:
    """Return the text of an indented XML file of OpenSim."""
    whole = xml("OpenSimDocument", root, Version=OSIM_VERSION)
    ElementTree.indent(whole, "\t")
    return f'<?xml version="1.0" encoding="UTF-8" ?>\n{ElementTree.tostring(whole, encoding="unicode")}\n'


def model_xml(body: Places, model: CoordinateModel) -> str:
    """Return the model as XML; bodies stand upright with arms down where all coordinates are zero."""
    parts = segments(body, model)
    markers = (_marker(part, *marker) for part in parts for marker in part.markers.items())
    head = xml_texts(
        credits=f"anchorpose {__version__}: joint centres of one recording. Research use only.",
        length_units="meters",
        force_units="N",
        gravity="0 -9.80665 0",
    )
    return document(
        xml(
            "Model",
            *head,
            xml("Ground", name="ground"),
            xml_set("BodySet", "bodyset", map(_body, parts)),
            xml_set("JointSet", "jointset", map(_joint, parts)),
            xml_set("MarkerSet", "markerset", markers),
            name="anchorpose",
        )
    )


def _body(part: OsimBody) -> ElementTree.Element:
    mass = MASS_SHARE[part.name.split("_")[0]] * NOMINAL_MASS_KG
    start, end = part.rods[0]
    length = float(np.linalg.norm(end - start))
    across, along = mass * (length**2 / 12.0 + 0.05**2 / 4.0), mass * 0.05**2 / 2.0  # inertia of a rod of 5 cm radius
    texts = xml_texts(
        mass=_numbers([mass]),
        mass_center=_numbers(np.array(part.rods[0]).mean(axis=0)),
        inertia=_numbers([across, along, across, 0.0, 0.0, 0.0]),
    )
    rods = (_rod(f"{part.name}_rod{number}", *rod) for number, rod in enumerate(part.rods))
    return xml("Body", *texts, xml("components", *rods), name=part.name)


def _rod(name: str, start: np.ndarray, end: np.ndarray) -> ElementTree.Element:
    """Return the XML of a cylinder from ``start`` to ``end``; OpenSim's cylinder is along Y."""
    along = end - start
    length = float(np.linalg.norm(along))
    sizes = xml_texts(radius=_numbers([ROD_RADIUS_M]), half_height=_numbers([length / 2.0]))
    shape = xml("attached_geometry", xml("Cylinder", *sizes, name=f"{name}_shape"))
    # body-fixed rotations about X, then Z, which bring Y along the rod (OpenSim's X-Y-Z without a rotation about Y)
    along = along / length if length else np.array(Y)
    turn = (np.arctan2(along[2], along[1]), 0.0, np.arcsin(np.clip(-along[0], -1.0, 1.0)))
    return _offset_frame(name, "..", (start + end) / 2.0, _numbers(turn), shape)


def _offset_frame(
    name: str, owner: str, place_m: np.ndarray, turn: str, *content: ElementTree.Element
) -> ElementTree.Element:
    texts = xml_texts(socket_parent=owner, translation=_numbers(place_m), orientation=turn)
    return xml("PhysicalOffsetFrame", *content, *texts, name=name)


def _joint(part: OsimBody) -> ElementTree.Element:
    ends = (f"{part.joint}_in_parent", f"{part.joint}_in_child")
    owner = "/ground" if part.parent == "ground" else f"/bodyset/{part.parent}"
    frames = (
        _offset_frame(ends[0], owner, part.place_m, "0 0 0"),
        _offset_frame(ends[1], f"/bodyset/{part.name}", np.zeros(3), "0 0 0"),
    )
    return xml(
        "CustomJoint",
        *xml_texts(socket_parent_frame=ends[0], socket_child_frame=ends[1]),
        xml("coordinates", *map(_coordinate, part.coordinates)),
        xml("frames", *frames),
        _transform(part.coordinates),
        name=part.joint,
    )


def _coordinate(coordinate: OsimCoordinate) -> ElementTree.Element:
    default, limits = _numbers([coordinate.default]), _numbers(coordinate.range)
    return xml("Coordinate", *xml_texts(default_value=default, range=limits, clamped="true"), name=coordinate.name)


def _transform(coordinates: tuple[OsimCoordinate, ...]) -> ElementTree.Element:
    """Return the XML of a joint's axes: three axes of rotation, then three axes of translation; an axis without a
    coordinate is fixed.
    """
    transform = xml("SpatialTransform")
    for kind, moves in (("rotation", False), ("translation", True)):
        used = [coordinate for coordinate in coordinates if coordinate.moves is moves]
        axes = [coordinate.axis for coordinate in used]
        spare = [axis for axis in (X, Y, Z) if not any(abs(np.dot(axis, other)) > 0.5 for other in axes)]
        constant = [("", axis, xml("Constant", xml("value", "0"), name="function")) for axis in spare]
        moving = [(c.name, c.axis, xml("LinearFunction", xml("coefficients", "1 0"), name="function")) for c in used]
        for number, (name, axis, function) in enumerate(moving + constant, 1):
            texts = xml_texts(coordinates=name, axis=_numbers(axis))
            transform.append(xml("TransformAxis", *texts, function, name=f"{kind}{number}"))
    return transform


def _marker(part: OsimBody, name: str, place_m: np.ndarray) -> ElementTree.Element:
    texts = xml_texts(socket_parent_frame=f"/bodyset/{part.name}", location=_numbers(place_m), fixed="true")
    return xml("Marker", *texts, name=name)


def _numbers(values: Iterable[float] | np.ndarray) -> str:
    return " ".join(f"{float(value):.6g}" for value in values)
