"""Compute axes.parquet: the position of each knee and elbow, and the axis about which it bends (Section III of the
paper that README.md cites).

The axis is the normal of the plane in which the two bones of the limb lie. A straight limb does not determine this
plane. The body model's hinge, an axis fixed to the upper bone, would also give an axis for a straight limb. But depth
images hardly show how far a bone is rotated about its long axis. In the four simulated clinics used for tuning, the
root-mean-square error of the knees' axes is some 7 degrees if the axis is taken from the hinge, and 2 if it is taken
from the plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.recording_file import FARTHEST_CAMERA_M
from anchorpose.results.angle_definition import PLANE_UNKNOWN_RAD
from anchorpose.results.frame_table import FrameTable, Numbers
from anchorpose.results.parquet import MEASURE_AGAIN
from anchorpose.results.tables import LARGEST_SIGMA, JointTable

REVOLUTE_JOINTS: Final = ("ElbowLeft", "ElbowRight", "KneeLeft", "KneeRight")
_ENDS: Final = {"Elbow": ("Shoulder", "Wrist"), "Knee": ("Hip", "Ankle")}
UNIT: Final = 1e-9  # maximum deviation of a unit vector's length from 1, by rounding


def _limb(name: str) -> list[int]:
    """Return the indices of the joint above a knee or elbow, of the knee or elbow itself, and of the joint below it."""
    kind, side = (name[:-4], "Left") if name.endswith("Left") else (name[:-5], "Right")
    above, below = _ENDS[kind]
    return [JOINT_INDEX[f"{joint}{side}"] for joint in (above, kind, below)]


LIMBS: Final = np.array([_limb(name) for name in REVOLUTE_JOINTS])
"""(4, 3): the indices of the joints above, at and below each of ``REVOLUTE_JOINTS``."""


@dataclass(frozen=True, slots=True, eq=False)
class AxisTable:
    """Knees and elbows of all frames, in the order of ``REVOLUTE_JOINTS``.

    frame (n,) int32, time_s (n,) float64; position_m (n, 4, 3): the joint; axis (n, 4, 3): unit vector in world
    coordinates; a right-handed rotation of the lower bone about this vector bends the limb further; sigma_deg (n, 4):
    one standard deviation of the axis in the direction in which it is least certain. position_m, axis and sigma_deg are
    float64, NaN where missing.
    """

    frame: np.ndarray
    time_s: np.ndarray
    position_m: np.ndarray
    axis: np.ndarray
    sigma_deg: np.ndarray


def _agree(axes: AxisTable) -> bool:
    """Return whether every axis is either missing completely, or a unit vector with a position and a sigma."""
    every = np.concatenate([axes.position_m, axes.axis, axes.sigma_deg[..., None]], axis=-1)
    whole = np.isfinite(every).all(axis=-1) & (np.abs(np.linalg.norm(axes.axis, axis=-1) - 1.0) < UNIT)
    return bool((whole | np.isnan(every).all(axis=-1)).all())


AXES: Final = FrameTable(
    file="axes.parquet",
    arrays=AxisTable,
    thing="joint",
    names=REVOLUTE_JOINTS,
    columns={
        "position_m": Numbers(("x_m", "y_m", "z_m"), -FARTHEST_CAMERA_M, FARTHEST_CAMERA_M),
        "axis": Numbers(("axis_x", "axis_y", "axis_z"), -1.0 - UNIT, 1.0 + UNIT),
        "sigma_deg": Numbers(("sigma_deg",), 0.0, LARGEST_SIGMA),
    },
    agree=_agree,
    remedy=MEASURE_AGAIN,
)
AXES_FILE, read_axes, write_axes = AXES.file, AXES.read, AXES.write


def revolute_axes(joints: JointTable) -> AxisTable:
    """Return the axes of all frames, NaN where one of the three joints is lost or the limb is bent by less than
    ``PLANE_UNKNOWN_RAD``, since noise then determines the plane.

    If one of the three joints moves by d out of their plane, the normal turns by -d g, where g is the gradient of this
    joint's barycentric coordinate in the plane. The joints' errors out of the plane are assumed independent.
    """
    place, sigma_m = joints.position_m[:, LIMBS], joints.sigma_m[:, LIMBS]
    upper, lower = place[:, :, 1] - place[:, :, 0], place[:, :, 2] - place[:, :, 1]
    normal = np.cross(upper, lower)
    with np.errstate(invalid="ignore", divide="ignore"):
        area2 = np.linalg.norm(normal, axis=-1, keepdims=True)
        axis = normal / area2
        sine = area2[..., 0] / (np.linalg.norm(upper, axis=-1) * np.linalg.norm(lower, axis=-1))
        share = np.cross(axis[:, :, None], np.stack([lower, -(upper + lower), upper], axis=2)) / area2[:, :, None]
        turned = sigma_m[..., None] * share
        sigma_deg = np.degrees(np.linalg.norm(np.nan_to_num(turned), ord=2, axis=(2, 3)))
    known = (sine >= np.sin(PLANE_UNKNOWN_RAD)) & np.isfinite(place).all(axis=(2, 3))
    at, axis = (np.where(known[..., None], one, np.nan) for one in (place[:, :, 1], axis))
    return AxisTable(joints.frame, joints.time_s, at, axis, np.where(known, sigma_deg, np.nan))
