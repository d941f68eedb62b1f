"""Write model.osim for OpenSim 4: the patient's bodies, joints and markers, measured over all frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree

import numpy as np

from anchorpose import __version__
from anchorpose.exports.opensim_coordinates import SIDES, in_axes, joint, pelvis_axes, torso_axes
from anchorpose.options import CoordinateModel
from anchorpose.results.joint_angles import SOLE_SLOPE_DEG


@dataclass(frozen=True, slots=True, eq=False)
class Limb:
    """Lengths in metres from joint to joint."""

    thigh: float
    shank: float
    foot: float
    upper_arm: float
    forearm: float
    hand: float


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredBody:
    """Metres. hips and shoulders (2, 3), right then left: from SpineBase in pelvis axes, from SpineMid in torso axes.

    spine_mid (3,) from SpineBase in pelvis axes; spine_shoulder, neck (3,) from SpineMid in torso axes; head (3,) from
    the neck in torso axes.
    """

    hips: np.ndarray
    shoulders: np.ndarray
    spine_mid: np.ndarray
    spine_shoulder: np.ndarray
    neck: np.ndarray
    head: np.ndarray
    limbs: tuple[Limb, Limb]  # right, left


def measure_body(position_m: np.ndarray) -> MeasuredBody | None:
    """Medians over the frames (n, 21, 3); None where the two ends of a bone are never known together."""
    pelvis, torso = pelvis_axes(position_m), torso_axes(position_m)

    def middle(axes: np.ndarray, start: str, end: str) -> np.ndarray:
        places = in_axes(axes, joint(position_m, end) - joint(position_m, start))
        known = places[np.isfinite(places).all(axis=1)]
        return np.median(known, axis=0) if len(known) else np.full(3, np.nan)

    limbs = [_limb(position_m, side) for side, _, _ in SIDES]
    body = MeasuredBody(
        hips=np.stack([middle(pelvis, "SpineBase", f"Hip{side}") for side, _, _ in SIDES]),
        shoulders=np.stack([middle(torso, "SpineMid", f"Shoulder{side}") for side, _, _ in SIDES]),
        spine_mid=middle(pelvis, "SpineBase", "SpineMid"),
        spine_shoulder=middle(torso, "SpineMid", "SpineShoulder"),
        neck=middle(torso, "SpineMid", "Neck"),
        head=middle(torso, "Neck", "Head"),
        limbs=(limbs[0], limbs[1]),
    )
    lengths = [getattr(limb, name) for limb in limbs for name in Limb.__slots__]
    places = [body.hips, body.shoulders, body.spine_mid, body.spine_shoulder, body.neck, body.head, np.array(lengths)]
    return body if all(np.isfinite(place).all() for place in places) else None


def _limb(position_m: np.ndarray, side: str) -> Limb:
    def length(start: str, end: str) -> float:
        along = np.linalg.norm(joint(position_m, f"{end}{side}") - joint(position_m, f"{start}{side}"), axis=1)
        known = along[np.isfinite(along)]
        return float(np.median(known)) if len(known) else float("nan")

    return Limb(
        thigh=length("Hip", "Knee"),
        shank=length("Knee", "Ankle"),
        foot=length("Ankle", "Foot"),
        upper_arm=length("Shoulder", "Elbow"),
        forearm=length("Elbow", "Wrist"),
        hand=length("Wrist", "Hand"),
    )


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
Axis = tuple[float, float, float]

# Segment masses as shares of the body's (de Leva 1996, doi:10.1016/0021-9290(95)00178-6, men; pelvis is the lower
# trunk, torso the upper and middle trunk, the forearm has the hand with it).
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
    """A coordinate of a joint: its axis in the parent, its default value and, in radians or metres, its range."""

    name: str
    axis: Axis
    range: tuple[float, float]
    default: float = 0.0
    moves: bool = False  # along the axis, not about it


@dataclass(frozen=True, slots=True, eq=False)
class OsimBody:
    """A body, the joint that connects it to its parent, and the markers on it, each (3,) metres in the body."""

    name: str
    kind: str  # key of MASS_SHARE
    parent: str  # a path in the model
    joint: str
    place_m: np.ndarray  # of the joint in the parent
    coordinates: tuple[OsimCoordinate, ...]
    markers: tuple[tuple[str, np.ndarray], ...]
    rods: tuple[tuple[np.ndarray, np.ndarray], ...]  # drawn as cylinders from end to end


def segments(body: MeasuredBody, model: CoordinateModel) -> tuple[OsimBody, ...]:
    """All bodies, parents first. Coordinates have the names and signs of ``model``."""
    sided = [
        segment
        for index, (side, end, sign) in enumerate(SIDES)
        for segment in (
            *_leg(body.limbs[index], body.hips[index], side, end, sign, model),
            *_arm(body.limbs[index], body.shoulders[index], side, end, sign),
        )
    ]
    return (_pelvis(body), *_trunk(body), *sided)


def _pelvis(body: MeasuredBody) -> OsimBody:
    zero = np.zeros(3)
    turns = tuple(  # so wide that a patient who turns round reaches no limit, where inverse kinematics would stop
        OsimCoordinate(f"pelvis_{name}", axis, (-4.0 * np.pi, 4.0 * np.pi))
        for name, axis in (("tilt", Z), ("list", X), ("rotation", Y))
    )
    moves = tuple(
        OsimCoordinate(f"pelvis_t{name}", axis, (-50.0, 50.0), 0.95 if name == "y" else 0.0, moves=True)
        for name, axis in (("x", X), ("y", Y), ("z", Z))
    )
    hips = tuple((f"Hip{side}", body.hips[index]) for index, (side, _, _) in enumerate(SIDES))
    return OsimBody(
        "pelvis",
        "pelvis",
        "/ground",
        "ground_pelvis",
        zero,
        turns + moves,
        (("SpineBase", zero), ("SpineMid", body.spine_mid), *hips),
        ((zero, body.spine_mid), (body.hips[0], body.hips[1])),
    )


def _trunk(body: MeasuredBody) -> tuple[OsimBody, OsimBody]:
    zero, quarter = np.zeros(3), np.pi / 2
    back = tuple(
        OsimCoordinate(f"lumbar_{name}", axis, (-quarter, quarter))
        for name, axis in (("extension", Z), ("bending", X), ("rotation", Y))
    )
    neck = (
        OsimCoordinate("neck_extension", Z, (-quarter, quarter)),
        OsimCoordinate("neck_bending", X, (-quarter, quarter)),
    )
    # the shoulder girdle moves on the chest, for which this model has no joint: shoulders are markers of the arms
    torso = OsimBody(
        "torso",
        "torso",
        "/bodyset/pelvis",
        "back",
        body.spine_mid,
        back,
        (("SpineShoulder", body.spine_shoulder), ("Neck", body.neck)),
        ((zero, body.spine_shoulder), (body.spine_shoulder, body.neck), (body.shoulders[0], body.shoulders[1])),
    )
    head = OsimBody(
        "head", "head", "/bodyset/torso", "neck", body.neck, neck, (("Head", body.head),), ((zero, body.head),)
    )
    return torso, head


def _leg(
    limb: Limb, hip: np.ndarray, side: str, end: str, sign: int, model: CoordinateModel
) -> tuple[OsimBody, OsimBody, OsimBody]:
    knee_axis = (0.0, 0.0, -1.0) if model is CoordinateModel.RAJAGOPAL else Z
    bent, straight = np.radians(150.0), np.radians(10.0)
    knee_range = (-straight, bent) if model is CoordinateModel.RAJAGOPAL else (-bent, straight)
    knee, ankle = _down(limb.thigh), _down(limb.shank)
    slope = np.radians(SOLE_SLOPE_DEG)
    toe = limb.foot * np.array([np.cos(slope), -np.sin(slope), 0.0])
    zero = np.zeros(3)
    return (
        OsimBody(
            f"femur_{end}",
            "femur",
            "/bodyset/pelvis",
            f"hip_{end}",
            hip,
            _ball(("hip_flexion", "hip_adduction", "hip_rotation"), end, sign, (-40.0, 140.0, 60.0, 60.0)),
            (),
            ((zero, knee),),
        ),
        OsimBody(
            f"tibia_{end}",
            "tibia",
            f"/bodyset/femur_{end}",
            f"walker_knee_{end}",
            knee,
            (OsimCoordinate(f"knee_angle_{end}", knee_axis, knee_range),),
            ((f"Knee{side}", zero),),
            ((zero, ankle),),
        ),
        OsimBody(
            f"calcn_{end}",
            "calcn",
            f"/bodyset/tibia_{end}",
            f"ankle_{end}",
            ankle,
            (OsimCoordinate(f"ankle_angle_{end}", Z, (-np.pi / 3, np.pi / 3)),),
            ((f"Ankle{side}", zero), (f"Foot{side}", toe)),
            ((zero, toe),),
        ),
    )


def _arm(limb: Limb, shoulder: np.ndarray, side: str, end: str, sign: int) -> tuple[OsimBody, OsimBody]:
    zero, elbow, wrist = np.zeros(3), _down(limb.upper_arm), _down(limb.forearm)
    hand = _down(limb.forearm + limb.hand)
    return (
        OsimBody(
            f"humerus_{end}",
            "humerus",
            "/bodyset/torso",
            f"acromial_{end}",
            shoulder,
            _ball(("arm_flex", "arm_add", "arm_rot"), end, sign, (-90.0, 180.0, 180.0, 120.0)),
            ((f"Shoulder{side}", zero),),
            ((zero, elbow),),
        ),
        OsimBody(
            f"ulna_{end}",
            "ulna",
            f"/bodyset/humerus_{end}",
            f"elbow_{end}",
            elbow,
            (OsimCoordinate(f"elbow_flex_{end}", Z, (0.0, np.radians(160.0))),),
            ((f"Elbow{side}", zero), (f"Wrist{side}", wrist), (f"Hand{side}", hand)),
            ((zero, hand),),
        ),
    )


def _ball(
    names: tuple[str, str, str], end: str, sign: int, limits_deg: tuple[float, float, float, float]
) -> tuple[OsimCoordinate, ...]:
    """Flexion, adduction and rotation inwards, mirrored on the left; limits: least and most flexion, then +- each."""
    least, most, aside, about = np.radians(limits_deg)
    ranges = ((least, most), (-aside, aside), (-about, about))
    axes: tuple[Axis, ...] = (Z, (float(sign), 0.0, 0.0), (0.0, float(sign), 0.0))
    return tuple(
        OsimCoordinate(f"{name}_{end}", axis, limits) for name, axis, limits in zip(names, axes, ranges, strict=True)
    )


def _down(length: float) -> np.ndarray:
    return np.array([0.0, -length, 0.0])


OSIM_VERSION: Final = "40000"  # of the file format; every OpenSim 4 reads it
NOMINAL_MASS_KG: Final = 75.0
"""An adult's: the patient's is unknown, OpenSim needs one to load the model, and kinematics do not use it."""

ROD_RADIUS_M: Final = 0.012


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
    along = along / length if length else np.array(Y)
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
    for where, owner, place in (("parent", part.parent, part.place_m), ("child", f"/bodyset/{part.name}", np.zeros(3))):
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
        spare = [axis for axis in (X, Y, Z) if not any(abs(np.dot(axis, other)) > 0.5 for other in axes)]
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
