"""Axes of pelvis and trunk from joint centres, and the angles between segments that OpenSim calls coordinates.

Axes are X forward, Y up, Z right, as OpenSim's bodies have them. Joint centres say nothing of a turn about a thigh's,
an upper arm's or a forearm's own long axis.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.joints import JOINT_INDEX
from anchorpose.rotations import unit

LOWER_SPINE_LEAN_DEG: Final = 4.4
UPPER_SPINE_LEAN_DEG: Final = 5.2
FOOT_SLOPE_DEG: Final = 19.3
"""Of the mean body that stands upright: hips to SpineMid leans back by the first, SpineMid to SpineShoulder
forward by the second, and the line from ankle to foot falls by the third (1.5 degrees from body to body). They set the
zeros of pelvis, lumbar and ankle coordinates; a test holds them to the body asset."""


def joint(position_m: np.ndarray, name: str) -> np.ndarray:
    """(n, 3) the path of a joint."""
    return position_m[:, JOINT_INDEX[name]]


def pelvis_axes(position_m: np.ndarray) -> np.ndarray:
    """(n, 3, 3) columns X, Y, Z in the world; Z along the hips, Y towards SpineMid; NaN where a joint is missing."""
    right = joint(position_m, "HipRight") - joint(position_m, "HipLeft")
    middle = 0.5 * (joint(position_m, "HipRight") + joint(position_m, "HipLeft"))
    up = joint(position_m, "SpineMid") - middle
    z = unit(right)
    x = unit(np.cross(up, z))
    return _about_z(np.stack([x, np.cross(z, x), z], axis=-1), -LOWER_SPINE_LEAN_DEG)


def torso_axes(position_m: np.ndarray) -> np.ndarray:
    """(n, 3, 3) columns X, Y, Z in the world; Y by the upper spine, turned about it by the shoulders."""
    right = joint(position_m, "ShoulderRight") - joint(position_m, "ShoulderLeft")
    y = unit(joint(position_m, "SpineShoulder") - joint(position_m, "SpineMid"))
    x = unit(np.cross(y, right))
    return _about_z(np.stack([x, y, np.cross(x, y)], axis=-1), UPPER_SPINE_LEAN_DEG)


def in_axes(axes: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """(n, 3) world vectors in the axes (n, 3, 3)."""
    return np.einsum("nji,nj->ni", axes, vector)


def turns_deg(axes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """OpenSim's three turns of a pelvis or trunk: ``axes = Rz(first) Rx(second) Ry(third)``, each (n,) degrees."""
    second = np.arcsin(np.clip(axes[:, 2, 1], -1.0, 1.0))
    first = np.arctan2(-axes[:, 0, 1], axes[:, 1, 1])
    third = np.arctan2(-axes[:, 2, 0], axes[:, 2, 2])
    return np.degrees(first), np.degrees(second), np.degrees(third)


def limb_turns_deg(direction: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Flexion and adduction (n,) of a limb that hangs along -Y at zero; direction (n, 3) in the axes above it.

    side: 1 right, -1 left; adduction is towards the middle on both.
    """
    along = unit(direction)
    flexion = np.arctan2(along[:, 0], -along[:, 1])
    return np.degrees(flexion), np.degrees(np.arcsin(np.clip(-side * along[:, 2], -1.0, 1.0)))


def bend_deg(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(n,) angle between two vectors, exact for small ones too; NaN where one is missing or has no length."""
    along = np.sum(unit(first) * unit(second), axis=-1)
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(unit(first), unit(second)), axis=-1), along))


def _about_z(axes: np.ndarray, degrees: float) -> np.ndarray:
    """The axes turned about their own Z."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return axes @ np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
