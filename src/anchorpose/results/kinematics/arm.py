"""Shoulder and elbow of one side."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from anchorpose.results.kinematics.definition import AngleGroup, Points, Reading
from anchorpose.results.kinematics.segments import trunk_axes
from anchorpose.results.kinematics.vectors import between, dot, unit


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
        AngleGroup((f"elbow_flexion_{end}",), (shoulder, elbow, wrist), partial(elbow_bend, side=side)),
    )


ARMS: Final = (*_arm("Left"), *_arm("Right"))
