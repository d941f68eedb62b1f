"""poses.parquet: where each bone of the learnt body is and how it is rotated, which joint centres alone do not say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import pyarrow as pa
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset
from anchorpose.body.pose import MOVING_BONES, Pose
from anchorpose.results.frame_table import FrameTable, Numbers
from anchorpose.results.parquet import TRACK_AGAIN


@dataclass(frozen=True, slots=True, eq=False)
class BodyPose:
    """The learnt body in one frame, bones in the order of ``MOVING_BONES``; all NaN where the patient is lost.

    head_m (21, 3): the bone's head, world. quaternion (21, 4): w, x, y, z of the rotation from the rest pose, whose
    axes are X forward, Y up and Z to the right, to the world; w is not negative. axial_sigma_rad (21,): one standard
    deviation of the rotation about the bone's long axis relative to its parent, from the registration's posterior; NaN
    where unknown. It is not calibrated and too small for thighs (simulations had errors of 12 degrees at a sigma of 3).
    """

    frame: int
    time_s: float
    head_m: np.ndarray
    quaternion: np.ndarray
    axial_sigma_rad: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class PoseTable:
    """All frames: frame (n,) int32, time_s (n,) float64, head_m (n, 21, 3), quaternion (n, 21, 4), axial_sigma_rad
    (n, 21), float32, each as in ``BodyPose``."""

    frame: np.ndarray
    time_s: np.ndarray
    head_m: np.ndarray
    quaternion: np.ndarray
    axial_sigma_rad: np.ndarray


POSES: Final = FrameTable(
    file="poses.parquet",
    arrays=PoseTable,
    thing="bone",
    names=MOVING_BONES,
    columns={
        "head_m": Numbers(("x_m", "y_m", "z_m"), pa.float32()),
        "quaternion": Numbers(("qw", "qx", "qy", "qz"), pa.float32()),
        "axial_sigma_rad": Numbers(("axial_sigma_rad",), pa.float32()),
    },
    remedy=TRACK_AGAIN,
)
POSES_FILE, read_poses, write_poses = POSES.file, POSES.read, POSES.open


def pose_of(asset: BodyAsset, head_m: np.ndarray, quaternion: np.ndarray) -> Pose:
    """The body's pose in one frame of the table; ``BodyMesh.bone_transforms`` gives the place of every bone.

    head_m (21, 3), quaternion (21, 4) of a frame in which the patient is not lost. Bones that do not move keep their
    rest pose. Raises ValueError for a lost frame.
    """
    if not (np.isfinite(head_m).all() and np.isfinite(quaternion).all()):
        raise ValueError("the patient is lost in this frame and has no pose")
    rotations = Rotation.from_quat(quaternion.astype(np.float64), scalar_first=True).as_matrix()
    row_of = {asset.bone(name): row for row, name in enumerate(MOVING_BONES)}
    in_world, relative = list[np.ndarray](), list[np.ndarray]()
    for bone, parent in enumerate(asset.bone_parents.tolist()):
        above = in_world[parent] if parent >= 0 else np.eye(3)
        in_world.append(rotations[row_of[bone]] if bone in row_of else above)
        relative.append(above.T @ in_world[bone])
    return Pose(np.stack(relative), head_m[MOVING_BONES.index("Hips")].astype(np.float64))
