"""Shoulder and elbow of one side."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from anchorpose.results.kinematics.definition import PLANE_KNOWN_RAD, AngleGroup, Points, Reading, hinge_sigma
from anchorpose.results.kinematics.segments import trunk_axes
from anchorpose.results.kinematics.vectors import between, cross, dot, length, unit

CARRYING_RAD: Final = np.radians(5.0)
"""One standard deviation of the elbow's carrying angle; taken, not measured here."""


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


def shoulder_turn(points: Points, side: str) -> tuple[Reading, ...]:
    """How the upper arm is turned about its own axis, by the plane in which the arm is bent: 0 = the forearm of the
    hanging arm points forward; positive = turned inwards, the hand towards the other side.

    What is left of the arm's turn against the trunk after the shortest swing from hanging. ISB's third angle is not
    determined for an arm that hangs, which is where patients hold theirs. An arm that is bent by less than
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


def elbow_bend(points: Points, side: str) -> tuple[Reading, ...]:
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
            partial(shoulder_turn, side=side),
            partial(hinge_sigma, limb=(shoulder, elbow, wrist), aside_rad=CARRYING_RAD),
        ),
        AngleGroup((f"elbow_flexion_{end}",), (shoulder, elbow, wrist), partial(elbow_bend, side=side)),
    )


ARMS: Final = (*_arm("Left"), *_arm("Right"))
