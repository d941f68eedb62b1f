"""Knee and elbow axes of the learnt body: they carry the turns about thigh and upper arm that joint centres do not."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import load_body_asset
from anchorpose.body.pose import MOVING_BONES, hinge_axes
from anchorpose.errors import InputError
from anchorpose.exports.osim_geometry import SIDES
from anchorpose.results.poses import PoseTable, read_poses


@dataclass(frozen=True, slots=True, eq=False)
class HingeAxes:
    """knee, elbow (n, 2, 3): unit axes in the world, right then left, each pointing to the right where the limb hangs
    down; NaN where the patient is lost."""

    knee: np.ndarray
    elbow: np.ndarray


def read_hinge_axes(path: Path, frame: np.ndarray) -> HingeAxes | None:
    """From poses.parquet; None where there is none. Raises InputError where its frames are not ``frame`` (n,)."""
    if not path.exists():
        return None
    poses = read_poses(path)
    if not np.array_equal(poses.frame, frame):
        raise InputError(path, "has other frames than joints.parquet", "track the recording again")
    sides = [side for side, _, _ in SIDES]
    return HingeAxes(
        # our knee bends about an axis to the left, OpenSim's about one to the right
        knee=np.stack([-_axis(poses, f"{side}UpLeg", f"{side}Leg") for side in sides], axis=1),
        elbow=np.stack([_axis(poses, f"{side}Arm", f"{side}ForeArm") for side in sides], axis=1),
    )


def _axis(poses: PoseTable, upper: str, lower: str) -> np.ndarray:
    """(n, 3) the axis about which the lower bone bends, carried by the upper."""
    hinge, _ = hinge_axes(load_body_asset(), lower)
    quaternion = poses.quaternion[:, MOVING_BONES.index(upper)].astype(np.float64)
    axis = np.full((len(quaternion), 3), np.nan)
    known = np.isfinite(quaternion).all(axis=1)
    axis[known] = Rotation.from_quat(quaternion[known], scalar_first=True).apply(hinge[0])
    return axis
