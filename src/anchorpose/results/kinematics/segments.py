"""Axes of the body's segments from joint centres: x forward, y up, z to the patient's right (ISB).

Sources: Wu et al. 2002 (doi:10.1016/S0021-9290(01)00222-6) for pelvis and spine, Wu et al. 2005
(doi:10.1016/j.jbiomech.2004.05.042) for thorax and arm. Their bony landmarks are not seen by depth; docs/angles.md says
which joint centres stand for them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anchorpose.results.kinematics.definition import Points
from anchorpose.results.kinematics.vectors import cross, square_to, unit


class Axes(NamedTuple):
    """Unit vectors (3, n) in the world."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray


def pelvis_axes(points: Points) -> Axes:
    """z along the hip joints, y towards SpineMid as far as that is square to z."""
    across = points["HipRight"] - points["HipLeft"]
    middle = 0.5 * (points["HipRight"] + points["HipLeft"])
    z = unit(across)
    y = square_to(points["SpineMid"] - middle, z)
    return Axes(cross(y, z), y, z)


def thorax_axes(points: Points) -> Axes:
    """y from SpineMid to SpineShoulder, z along the shoulders as far as that is square to y."""
    return _upright_axes(points["SpineShoulder"] - points["SpineMid"], points)


def trunk_axes(points: Points) -> Axes:
    """y from SpineBase to SpineShoulder: the whole trunk; z along the shoulders as far as that is square to y."""
    return _upright_axes(points["SpineShoulder"] - points["SpineBase"], points)


def _upright_axes(up: np.ndarray, points: Points) -> Axes:
    y = unit(up)
    z = square_to(points["ShoulderRight"] - points["ShoulderLeft"], y)
    return Axes(cross(y, z), y, z)
