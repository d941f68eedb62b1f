"""Define angles: names, the joints they are computed from, formulas, and the axes of the body's segments.

Arrays of vectors have the components on the first axis, (3, ...): numpy then works on whole rows of frames, several
times as fast. Axes are x forward, y up, z to the patient's right (ISB).

Sources: Wu et al. 2002 (doi:10.1016/S0021-9290(01)00222-6) for pelvis and spine, Wu et al. 2005
(doi:10.1016/j.jbiomech.2004.05.042) for thorax and arm. Depth does not show their bony landmarks; docs/angles.md states
which joint centres replace them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from anchorpose import rotations


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the dot product (...) of vectors (3, ...)."""
    product: np.ndarray = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product (3, ...)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def length(vector: np.ndarray) -> np.ndarray:
    """Return the length (...) of vectors (3, ...)."""
    return np.sqrt(dot(vector, vector))


def unit(vector: np.ndarray) -> np.ndarray:
    """Return vectors (3, ...) of length one; NaN where the vector has length zero."""
    return rotations.unit(vector, axis=0)


def square_to(vector: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return the unit vector (3, ...) along the part of ``vector`` that is perpendicular to the unit vector
    ``axis``.
    """
    return unit(vector - dot(vector, axis) * axis)


def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the angle (...) between vectors, exact also for small angles; NaN where a vector has length zero."""
    across, along = length(cross(a, b)), dot(a, b)
    return np.where((across == 0) & (along == 0), np.nan, np.arctan2(across, along))


def arcsin(sine: np.ndarray) -> np.ndarray:
    """Return the arcsine (...) of numbers, some of which rounding may have moved beyond 1."""
    angle: np.ndarray = np.arcsin(np.clip(sine, -1.0, 1.0))
    return angle


LEAST_LEVER: Final = 0.2588
"""Sine of 15 degrees. An angle about an axis is computed from the part of a vector that is perpendicular to the axis.
If that part is shorter than this share of the vector, the axes of the angle nearly coincide (gimbal lock) and a joint's
error is enlarged at least four times, so no value is given.
"""

PLANE_UNKNOWN_RAD: Final = np.radians(15.0)
PLANE_KNOWN_RAD: Final = np.radians(30.0)
"""Two angles of a bent limb. Below the first, the limb's plane of bending is mostly noise and the bow of the limb;
above the second, the plane is reliable.
"""

Points = Mapping[str, np.ndarray]
"""Joint centres by name, (3, n) each, metres, world."""

Reading = tuple[np.ndarray, "np.ndarray | float"]
"""An angle (n,) in radians, and its lever (n,): the share of the vector from which it is computed, see ``LEAST_LEVER``.
"""


@dataclass(frozen=True, slots=True)
class AngleGroup:
    """Angles that one formula computes from the same joints, in the order of ``names``.

    own_sigma: (n,) radians, standard deviation of the error that the formula has even with exact joints.
    """

    names: tuple[str, ...]
    joints: tuple[str, ...]
    formula: Callable[[Points], tuple[Reading, ...]]
    own_sigma: Callable[[Points], np.ndarray] | None = None


def hinge_sigma(points: Points, limb: tuple[str, str, str], aside_rad: float) -> np.ndarray:
    """Return (n,) radians: the standard deviation of the angle between the plane of a bent limb and the plane in which
    its hinge bends it.

    limb: the joints at its root, hinge and end. aside_rad: standard deviation, between people, of the angle by which
    limbs are bowed sideways. The less the limb is bent, the more a sideways bow rotates its plane.
    """
    root, hinge, end = (points[name] for name in limb)
    bent = np.sin(between(hinge - root, end - hinge))
    sigma: np.ndarray = np.arctan2(np.tan(aside_rad), bent)
    return sigma


class Axes(NamedTuple):
    """Unit vectors (3, n) in the world."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray


def pelvis_axes(points: Points) -> Axes:
    """Return the pelvis axes: z along the hip joints, y towards SpineMid, made perpendicular to z."""
    across = points["HipRight"] - points["HipLeft"]
    middle = 0.5 * (points["HipRight"] + points["HipLeft"])
    z = unit(across)
    y = square_to(points["SpineMid"] - middle, z)
    return Axes(cross(y, z), y, z)


def thorax_axes(points: Points) -> Axes:
    """Return the thorax axes: y from SpineMid to SpineShoulder, z along the shoulders, made perpendicular to y."""
    return _upright_axes(points["SpineShoulder"] - points["SpineMid"], points)


def trunk_axes(points: Points) -> Axes:
    """Return the axes of the whole trunk: y from SpineBase to SpineShoulder, z along the shoulders, made perpendicular
    to y.
    """
    return _upright_axes(points["SpineShoulder"] - points["SpineBase"], points)


def _upright_axes(up: np.ndarray, points: Points) -> Axes:
    y = unit(up)
    z = square_to(points["ShoulderRight"] - points["ShoulderLeft"], y)
    return Axes(cross(y, z), y, z)
