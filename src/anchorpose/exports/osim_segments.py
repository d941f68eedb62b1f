"""The patient's skeleton as OpenSim needs it: bodies, joints and markers, measured over all frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.exports.formats import CoordinateModel
from anchorpose.exports.opensim_coordinates import SIDES, in_axes, joint, pelvis_axes, torso_axes
from anchorpose.results.kinematics.joint_angles import SOLE_SLOPE_DEG


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
    "pelvis": 0.1117, "torso": 0.3229, "head": 0.0694, "femur": 0.1416, "tibia": 0.0433, "calcn": 0.0137,
    "humerus": 0.0271, "ulna": 0.0223,
}  # fmt: skip

ROUND: Final = 4.0 * np.pi
"""Range of the pelvis either way: a patient who faces -X, or turns round, must not reach a limit at 180 degrees, where
OpenSim's inverse kinematics would stop."""


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
    turns = tuple(
        OsimCoordinate(f"pelvis_{name}", axis, (-ROUND, ROUND))
        for name, axis in (("tilt", Z), ("list", X), ("rotation", Y))
    )
    moves = tuple(
        OsimCoordinate(f"pelvis_t{name}", axis, (-50.0, 50.0), 0.95 if name == "y" else 0.0, moves=True)
        for name, axis in (("x", X), ("y", Y), ("z", Z))
    )
    hips = tuple((f"Hip{side}", body.hips[index]) for index, (side, _, _) in enumerate(SIDES))
    return OsimBody(
        "pelvis", "pelvis", "/ground", "ground_pelvis", zero, turns + moves,
        (("SpineBase", zero), ("SpineMid", body.spine_mid), *hips),
        ((zero, body.spine_mid), (body.hips[0], body.hips[1])),
    )  # fmt: skip


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
        "torso", "torso", "/bodyset/pelvis", "back", body.spine_mid, back,
        (("SpineShoulder", body.spine_shoulder), ("Neck", body.neck)),
        ((zero, body.spine_shoulder), (body.spine_shoulder, body.neck), (body.shoulders[0], body.shoulders[1])),
    )  # fmt: skip
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
            f"femur_{end}", "femur", "/bodyset/pelvis", f"hip_{end}", hip,
            _ball(("hip_flexion", "hip_adduction", "hip_rotation"), end, sign, (-40.0, 140.0, 60.0, 60.0)),
            (), ((zero, knee),),
        ),
        OsimBody(
            f"tibia_{end}", "tibia", f"/bodyset/femur_{end}", f"walker_knee_{end}", knee,
            (OsimCoordinate(f"knee_angle_{end}", knee_axis, knee_range),),
            ((f"Knee{side}", zero),), ((zero, ankle),),
        ),
        OsimBody(
            f"calcn_{end}", "calcn", f"/bodyset/tibia_{end}", f"ankle_{end}", ankle,
            (OsimCoordinate(f"ankle_angle_{end}", Z, (-np.pi / 3, np.pi / 3)),),
            ((f"Ankle{side}", zero), (f"Foot{side}", toe)), ((zero, toe),),
        ),
    )  # fmt: skip


def _arm(limb: Limb, shoulder: np.ndarray, side: str, end: str, sign: int) -> tuple[OsimBody, OsimBody]:
    zero, elbow, wrist = np.zeros(3), _down(limb.upper_arm), _down(limb.forearm)
    hand = _down(limb.forearm + limb.hand)
    return (
        OsimBody(
            f"humerus_{end}", "humerus", "/bodyset/torso", f"acromial_{end}", shoulder,
            _ball(("arm_flex", "arm_add", "arm_rot"), end, sign, (-90.0, 180.0, 180.0, 120.0)),
            ((f"Shoulder{side}", zero),), ((zero, elbow),),
        ),
        OsimBody(
            f"ulna_{end}", "ulna", f"/bodyset/humerus_{end}", f"elbow_{end}", elbow,
            (OsimCoordinate(f"elbow_flex_{end}", Z, (0.0, np.radians(160.0))),),
            ((f"Elbow{side}", zero), (f"Wrist{side}", wrist), (f"Hand{side}", hand)), ((zero, hand),),
        ),
    )  # fmt: skip


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
