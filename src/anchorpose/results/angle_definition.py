"""Define the body's angles (names, the joints they are computed from, formulas) and the axes of its segments.

Arrays of vectors have the components x, y, z on the first axis: their shape is (3, ...). With this layout, numpy is
several times as fast as with the components on the last axis. A segment's axes are x forward, y up, z to the patient's
right (ISB).

Sources: Wu et al. 2002 (doi:10.1016/S0021-9290(01)00222-6) for pelvis and spine, Wu et al. 2005
(doi:10.1016/j.jbiomech.2004.05.042) for thorax and arm. Depth images do not show the bony landmarks that these papers
use; docs/angles.md states which joint centres replace them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from anchorpose import rotations


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the dot product, shape (...), of vectors of shape (3, ...)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product, shape (3, ...), of vectors of shape (3, ...)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def length(vector: np.ndarray) -> np.ndarray:
    """Return the length, shape (...), of vectors of shape (3, ...)."""
    return np.sqrt(dot(vector, vector))


def unit(vector: np.ndarray) -> np.ndarray:
    """Scale vectors of shape (3, ...) to length one. The result is NaN where a vector has length zero."""
    return rotations.unit(vector, axis=0)


def square_to(vector: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Remove from ``vector`` its component along the unit vector ``axis``; return the rest, shape (3, ...), scaled to
    length one.
    """
    return unit(vector - dot(vector, axis) * axis)


def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the angle in radians, shape (...), between vectors ``a`` and ``b`` of shape (3, ...), exact also for small
    angles; NaN where a vector has length zero.
    """
    across, along = length(cross(a, b)), dot(a, b)
    return np.where((across == 0) & (along == 0), np.nan, np.arctan2(across, along))


def arcsin(sine: np.ndarray) -> np.ndarray:
    """Return the arcsine of ``sine`` in radians, in the shape of ``sine``. Values that rounding has moved beyond -1 or
    1 count as -1 or 1.
    """
    return np.arcsin(np.clip(sine, -1.0, 1.0))


LEAST_LEVER: Final = 0.2588
"""Sine of 15 degrees. An angle about an axis is computed from the component of a vector that is perpendicular to the
axis. If this component is shorter than ``LEAST_LEVER`` times the vector, the angle has no value: the vector is then
nearly parallel to the axis (gimbal lock). An error in the position of a joint then changes the angle at least about
four times as much as it would for a perpendicular vector.
"""

PLANE_UNKNOWN_RAD: Final = np.radians(15.0)
PLANE_KNOWN_RAD: Final = np.radians(30.0)
"""Limits of the angle by which an arm or leg is bent. Below ``PLANE_UNKNOWN_RAD``, the plane in which the limb bends is
mostly determined by noise and by the limb's sideways bow; above ``PLANE_KNOWN_RAD``, the plane is reliable.
"""

Points = Mapping[str, np.ndarray]
"""Joint centres by name, each (3, n) in metres, in world coordinates."""

Reading = tuple[np.ndarray, "np.ndarray | float"]
"""An angle (n,) in radians, and its lever (n,): a number from 0 to 1 that states how well the joints determine the
angle, such as the ratio of lengths in ``LEAST_LEVER``. If the lever is below ``LEAST_LEVER``, the angle has no value.
"""


@dataclass(frozen=True, slots=True)
class AngleGroup:
    """A group of angles that one formula computes from the same joints. The formula returns the angles in the order of
    ``names``.

    own_sigma: function that returns the standard deviation (n,) in radians of the error that the formula makes even
    with exact joints.
    """

    names: tuple[str, ...]
    joints: tuple[str, ...]
    formula: Callable[[Points], tuple[Reading, ...]]
    own_sigma: Callable[[Points], np.ndarray] | None = None


def hinge_sigma(points: Points, side: str, limb: tuple[str, str, str], aside_rad: float) -> np.ndarray:
    """Return the error that a sideways bow of the limb causes, as a standard deviation (n,) in radians. The error is
    the angle between the plane through the limb's three joints and the plane perpendicular to the axis of its hinge
    (elbow or knee).

    limb: names, without the side, of the joints at the limb's root, hinge and end. aside_rad: standard deviation,
    between people, of the angle by which limbs are bowed sideways. The less the limb is bent, the more a sideways bow
    rotates the plane through its joints.
    """
    root, hinge, end = (points[f"{name}{side}"] for name in limb)
    bent = np.sin(between(hinge - root, end - hinge))
    return np.arctan2(np.tan(aside_rad), bent)


class Axes(NamedTuple):
    """The axes of a body segment in n frames, as unit vectors (3, n) in world coordinates."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray


def pelvis_axes(points: Points) -> Axes:
    """Return the pelvis axes: z from the left to the right hip joint, y perpendicular to z and towards SpineMid."""
    across = points["HipRight"] - points["HipLeft"]
    middle = 0.5 * (points["HipRight"] + points["HipLeft"])
    z = unit(across)
    y = square_to(points["SpineMid"] - middle, z)
    return Axes(cross(y, z), y, z)


def thorax_axes(points: Points) -> Axes:
    """Return the thorax axes: y from SpineMid to SpineShoulder, z perpendicular to y and towards the right shoulder."""
    return _upright_axes(points["SpineShoulder"] - points["SpineMid"], points)


def trunk_axes(points: Points) -> Axes:
    """Return the axes of the whole trunk: y from SpineBase to SpineShoulder, z perpendicular to y and towards the right
    shoulder.
    """
    return _upright_axes(points["SpineShoulder"] - points["SpineBase"], points)


def _upright_axes(up: np.ndarray, points: Points) -> Axes:
    y = unit(up)
    z = square_to(points["ShoulderRight"] - points["ShoulderLeft"], y)
    return Axes(cross(y, z), y, z)
