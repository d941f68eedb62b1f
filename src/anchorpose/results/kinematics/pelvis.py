"""Pelvis in the world: turned, then raised on one side, then tilted (Baker 2001, doi:10.1016/S0966-6362(00)00083-7).

In this order, the other way round than for joints, each of the three means what clinicians call by its name, also for
a patient who has turned.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.results.kinematics.definition import AngleGroup, Points, Reading
from anchorpose.results.kinematics.segments import pelvis_axes
from anchorpose.results.kinematics.vectors import arcsin, cross, dot, unit


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
