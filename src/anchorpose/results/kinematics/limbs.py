"""Angles of legs and arms: hip, knee, ankle, shoulder and elbow."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from anchorpose.results.kinematics.definition import (
    PLANE_KNOWN_RAD,
    PLANE_UNKNOWN_RAD,
    AngleGroup,
    Points,
    Reading,
    arcsin,
    between,
    cross,
    dot,
    hinge_sigma,
    length,
    pelvis_axes,
    square_to,
    trunk_axes,
    unit,
)

SOLE_SLOPE_DEG: Final = 19.3
"""How far the line from ankle to toe base falls towards the toes when the sole is level: mean of the body asset's
shapes; its standard deviation from person to person, 1.6 degrees, is not included in sigma."""


VARUS_VALGUS_RAD: Final = np.radians(3.0)
"""One standard deviation of how far knees are bowed in or out; assumed, not measured here."""


def hip_to_trunk(points: Points, side: str) -> tuple[Reading, ...]:
    """Thigh against the whole trunk in the patient's sagittal plane: 0 = in line, positive = knee forward."""
    right = unit(points["HipRight"] - points["HipLeft"])
    up = square_to(points["SpineShoulder"] - points["SpineBase"], right)
    return (_swing(up, right, unit(points[f"Knee{side}"] - points[f"Hip{side}"])),)


def hip_to_pelvis(points: Points, side: str) -> tuple[Reading, ...]:
    """Thigh against the pelvis in the joint coordinate system of ISB: flexion about the pelvis' z, then adduction."""
    pelvis, thigh = pelvis_axes(points), unit(points[f"Knee{side}"] - points[f"Hip{side}"])
    inwards = 1.0 if side == "Left" else -1.0
    return _swing(pelvis.y, pelvis.z, thigh), (inwards * arcsin(dot(thigh, pelvis.z)), 1.0)


def hip_rotation(points: Points, side: str) -> tuple[Reading, ...]:
    """Rotation of the thigh about its long axis, by the plane in which the leg is bent: 0 = the shank points straight
    back from the knee, perpendicular to the hip joints; positive = inwards, the foot to the outside.

    The last of ISB's Cardan angles z, x, y, the plane's normal being the thigh's z. A leg that is bent by less than
    ``PLANE_KNOWN_RAD`` has no such plane, and one that is bent backwards has it reversed: no value.
    """
    hip, knee, ankle = (points[f"{name}{side}"] for name in ("Hip", "Knee", "Ankle"))
    across, y = unit(points["HipRight"] - points["HipLeft"]), unit(hip - knee)
    normal = cross(unit(ankle - knee), y)  # as long as the sine of the bend
    bent, z = length(normal), unit(-normal)
    aside, along = dot(across, cross(y, z)), dot(across, z)
    inwards = -1.0 if side == "Left" else 1.0
    hinged = (bent >= np.sin(PLANE_KNOWN_RAD)) & (along > 0)  # bent the other way it is not the hinge that bends
    return ((inwards * np.arctan2(-aside, along), np.where(hinged, bent * np.hypot(aside, along), 0.0)),)


def knee_flexion(points: Points, side: str) -> tuple[Reading, ...]:
    """How far the leg is bent at the knee: 0 = straight, negative = bent backwards (hyperextended).

    The plane of bending of a nearly straight leg is that of noise and of bow legs, so only the rotation about the line
    of the hips counts, with either sign, so that noise about a straight knee has the mean zero. A clearly bent leg is
    bent in the plane of its hinge, and the whole angle between thigh and shank counts. Between ``PLANE_UNKNOWN_RAD``
    and ``PLANE_KNOWN_RAD`` one passes into the other. No knee bends backwards further than that, so beyond it the angle
    is positive and does not need the line of the hips.
    """
    hip, knee, ankle = (points[f"{name}{side}"] for name in ("Hip", "Knee", "Ankle"))
    thigh, shank = unit(knee - hip), unit(ankle - knee)
    across = unit(points["HipRight"] - points["HipLeft"])
    hinge, axis = square_to(across, thigh), cross(shank, thigh)
    bend, about_hinge = between(thigh, shank), dot(axis, hinge)
    clear = np.clip((bend - PLANE_UNKNOWN_RAD) / (PLANE_KNOWN_RAD - PLANE_UNKNOWN_RAD), 0.0, 1.0)
    part = np.arctan2(about_hinge, dot(thigh, shank))
    signed = clear * np.copysign(bend, about_hinge) + (1.0 - clear) * part
    return ((np.where(clear == 1.0, bend, signed), np.where(clear == 1.0, 1.0, length(cross(across, thigh)))),)


def ankle_dorsiflexion(points: Points, side: str) -> tuple[Reading, ...]:
    """Foot against shank: 0 = the sole of a mean foot perpendicular to the shank, positive = toes up (dorsiflexion)."""
    knee, ankle, foot = (points[f"{name}{side}"] for name in ("Knee", "Ankle", "Foot"))
    return ((0.5 * np.pi + np.radians(SOLE_SLOPE_DEG) - between(knee - ankle, foot - ankle), 1.0),)


def _swing(up: np.ndarray, right: np.ndarray, thigh: np.ndarray) -> Reading:
    ahead, along = dot(thigh, cross(up, right)), -dot(thigh, up)
    return np.arctan2(ahead, along), np.hypot(ahead, along)


def _leg(side: str) -> tuple[AngleGroup, ...]:
    end, hips = side.lower(), ("HipLeft", "HipRight")
    knee, ankle, foot = (f"{name}{side}" for name in ("Knee", "Ankle", "Foot"))
    return (
        AngleGroup(
            (f"hip_flexion_{end}",), ("SpineBase", "SpineShoulder", *hips, knee), partial(hip_to_trunk, side=side)
        ),
        AngleGroup(
            (f"hip_pelvis_flexion_{end}", f"hip_adduction_{end}"),
            ("SpineMid", *hips, knee),
            partial(hip_to_pelvis, side=side),
        ),
        AngleGroup(
            (f"hip_rotation_{end}",),
            (*hips, knee, ankle),
            partial(hip_rotation, side=side),
            partial(hinge_sigma, limb=(f"Hip{side}", knee, ankle), aside_rad=VARUS_VALGUS_RAD),
        ),
        AngleGroup((f"knee_flexion_{end}",), (*hips, knee, ankle), partial(knee_flexion, side=side)),
        AngleGroup((f"ankle_dorsiflexion_{end}",), (knee, ankle, foot), partial(ankle_dorsiflexion, side=side)),
    )


LEGS: Final = (*_leg("Left"), *_leg("Right"))


CARRYING_RAD: Final = np.radians(5.0)
"""One standard deviation of the elbow's carrying angle; assumed, not measured here."""


def shoulder_elevation(points: Points, side: str) -> tuple[Reading, ...]:
    """Upper arm against trunk, in whichever direction it is raised: 0 = along the trunk, pi = overhead."""
    trunk = points["SpineBase"] - points["SpineShoulder"]
    return ((between(trunk, points[f"Elbow{side}"] - points[f"Shoulder{side}"]), 1.0),)


def shoulder_plane(points: Points, side: str) -> tuple[Reading, ...]:
    """In which direction the arm is raised (ISB's plane of elevation): 0 = sideways, 90 degrees = forwards."""
    trunk, arm = trunk_axes(points), unit(points[f"Elbow{side}"] - points[f"Shoulder{side}"])
    outwards = 1.0 if side == "Right" else -1.0
    ahead, aside = dot(arm, trunk.x), outwards * dot(arm, trunk.z)
    return ((np.arctan2(ahead, aside), np.hypot(ahead, aside)),)


def shoulder_rotation(points: Points, side: str) -> tuple[Reading, ...]:
    """Rotation of the upper arm about its long axis, by the plane in which the arm is bent: 0 = the forearm of the
    hanging arm points forward; positive = inwards, the hand towards the other side.

    It is the arm's rotation relative to the trunk without the shortest swing from hanging. ISB's third angle is
    undetermined for a hanging arm, which is where patients hold theirs. An arm that is bent by less than
    ``PLANE_KNOWN_RAD`` has no such plane.
    """
    shoulder, elbow, wrist = (points[f"{name}{side}"] for name in ("Shoulder", "Elbow", "Wrist"))
    trunk, y = trunk_axes(points), unit(shoulder - elbow)
    normal = cross(unit(wrist - elbow), y)  # as long as the sine of the bend
    bent, z = length(normal), unit(normal)
    x = cross(y, z)
    inwards = 1.0 if side == "Right" else -1.0
    turn = np.arctan2(dot(trunk.x, z) - dot(trunk.z, x), dot(trunk.x, x) + dot(trunk.z, z))
    not_overhead = np.sqrt(np.clip(0.5 * (1.0 + dot(trunk.y, y)), 0.0, 1.0))
    hinged = bent >= np.sin(PLANE_KNOWN_RAD)
    return ((inwards * turn, np.where(hinged, bent * not_overhead, 0.0)),)


def elbow_flexion(points: Points, side: str) -> tuple[Reading, ...]:
    """How far the arm is bent at the elbow: 0 = straight, pi = folded."""
    shoulder, elbow, wrist = (points[f"{name}{side}"] for name in ("Shoulder", "Elbow", "Wrist"))
    return ((between(elbow - shoulder, wrist - elbow), 1.0),)


def _arm(side: str) -> tuple[AngleGroup, ...]:
    end, trunk = side.lower(), ("SpineBase", "SpineShoulder")
    shoulder, elbow, wrist = (f"{name}{side}" for name in ("Shoulder", "Elbow", "Wrist"))
    return (
        AngleGroup((f"shoulder_elevation_{end}",), (*trunk, shoulder, elbow), partial(shoulder_elevation, side=side)),
        AngleGroup(
            (f"shoulder_plane_{end}",),
            (*trunk, "ShoulderLeft", "ShoulderRight", elbow),
            partial(shoulder_plane, side=side),
        ),
        AngleGroup(
            (f"shoulder_rotation_{end}",),
            (*trunk, "ShoulderLeft", "ShoulderRight", elbow, wrist),
            partial(shoulder_rotation, side=side),
            partial(hinge_sigma, limb=(shoulder, elbow, wrist), aside_rad=CARRYING_RAD),
        ),
        AngleGroup((f"elbow_flexion_{end}",), (shoulder, elbow, wrist), partial(elbow_flexion, side=side)),
    )


ARMS: Final = (*_arm("Left"), *_arm("Right"))
