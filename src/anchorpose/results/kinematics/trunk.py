"""Pelvis and trunk in the world, trunk relative to the pelvis, and the line of the head relative to the thorax.

The pelvis is rotated, then raised on one side, then tilted (Baker 2001, doi:10.1016/S0966-6362(00)00083-7). In this
order, the reverse of that for joints, each of the three is what clinicians call by its name, also for a patient who has
turned.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.results.kinematics.definition import (
    AngleGroup,
    Axes,
    Points,
    Reading,
    arcsin,
    cross,
    dot,
    pelvis_axes,
    thorax_axes,
    unit,
)


def trunk_lean(points: Points) -> tuple[Reading, ...]:
    """The line from SpineBase to SpineShoulder against the world's vertical: forwards, then to the patient's right.

    Forwards is horizontal and perpendicular to the hip joints; where their line is nearly vertical (lying on a side),
    both angles are undetermined.
    """
    across, up = points["HipRight"] - points["HipLeft"], unit(points["SpineShoulder"] - points["SpineBase"])
    nothing = np.zeros_like(across[0])
    right = unit(np.stack([across[0], nothing, across[2]]))
    forward = np.stack([right[2], nothing, -right[0]])
    ahead, aside = dot(up, forward), dot(up, right)
    level = np.hypot(*unit(across)[[0, 2]])
    return (np.arctan2(ahead, up[1]), np.minimum(level, np.hypot(ahead, up[1]))), (arcsin(aside), level)


def trunk_heading(points: Points) -> tuple[Reading, ...]:
    """Where the shoulders face, about the world's vertical: 0 = along the world's X, positive to the left."""
    z = unit(points["ShoulderRight"] - points["ShoulderLeft"])
    return ((np.arctan2(z[0], z[2]), np.hypot(z[0], z[2])),)


def trunk_on_pelvis(points: Points) -> tuple[Reading, ...]:
    """Thorax against pelvis, Cardan angles in the order z, x, y: flexion, bend to the right, turn to the left."""
    pelvis, thorax = pelvis_axes(points), thorax_axes(points)
    aside = dot(pelvis.z, thorax.y)
    lever = np.sqrt(np.clip(1.0 - aside**2, 0.0, 1.0))
    turn = np.arctan2(-dot(pelvis.z, thorax.x), dot(pelvis.z, thorax.z))
    return (_flexion(pelvis, thorax.y), lever), (arcsin(aside), 1.0), (turn, lever)


def neck_lean(points: Points) -> tuple[Reading, ...]:
    """The line from Neck to Head against the thorax: flexion, then bend to the right."""
    thorax, line = thorax_axes(points), unit(points["Head"] - points["Neck"])
    aside = dot(thorax.z, line)
    return (_flexion(thorax, line), np.sqrt(np.clip(1.0 - aside**2, 0.0, 1.0))), (arcsin(aside), 1.0)


def _flexion(axes: Axes, line: np.ndarray) -> np.ndarray:
    return np.arctan2(dot(line, axes.x), dot(line, axes.y))


_HIPS, _SHOULDERS = ("HipLeft", "HipRight"), ("ShoulderLeft", "ShoulderRight")

TRUNK: Final = (
    AngleGroup(("trunk_flexion", "trunk_side_bend"), ("SpineBase", "SpineShoulder", *_HIPS), trunk_lean),
    AngleGroup(("trunk_rotation",), _SHOULDERS, trunk_heading),
    AngleGroup(
        ("trunk_pelvis_flexion", "trunk_pelvis_side_bend", "trunk_pelvis_rotation"),
        (*_HIPS, "SpineMid", "SpineShoulder", *_SHOULDERS),
        trunk_on_pelvis,
    ),
)

NECK: Final = (
    AngleGroup(
        ("neck_flexion", "neck_side_bend"), ("SpineMid", "SpineShoulder", *_SHOULDERS, "Neck", "Head"), neck_lean
    ),
)


def pelvis_angles(points: Points) -> tuple[Reading, ...]:
    """Tilt (front down positive), obliquity (right hip higher positive), rotation (turned to the left positive)."""
    pelvis = pelvis_axes(points)
    z = pelvis.z
    level = np.hypot(z[0], z[2])
    forward = unit(np.stack([z[2], np.zeros_like(level), -z[0]]))  # the world's vertical, crossed with z
    tilt = np.arctan2(dot(pelvis.y, forward), dot(pelvis.y, cross(z, forward)))
    return (tilt, level), (arcsin(z[1]), 1.0), (np.arctan2(z[0], z[2]), level)


PELVIS: Final = (
    AngleGroup(
        ("pelvis_tilt", "pelvis_obliquity", "pelvis_rotation"), ("HipLeft", "HipRight", "SpineMid"), pelvis_angles
    ),
)
