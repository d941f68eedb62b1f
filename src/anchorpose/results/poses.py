"""poses.parquet: where each bone of the learnt body is and how it is turned; joint centres alone do not say that."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset
from anchorpose.body.pose import MOVING_BONES, Pose
from anchorpose.results.frame_rows import from_rows, rows_schema, to_rows
from anchorpose.results.tables import FRAMES_PER_ROW_GROUP, RowGroups, open_parquet

POSES_FILE: Final = "poses.parquet"

POSES_SCHEMA: Final = rows_schema(
    "bone", ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz", "axial_sigma_rad"), pa.float32()
)


@dataclass(frozen=True, slots=True, eq=False)
class BodyPose:
    """The learnt body in one frame, bones in the order of ``MOVING_BONES``; all NaN where the patient is lost.

    head_m (21, 3): the bone's head, world. quaternion (21, 4): w, x, y, z of the turn from the rest pose, whose axes
    are X forward, Y up and Z to the right, to the world; w is not negative. axial_sigma_rad (21,): one standard
    deviation of the turn about the bone's own long axis against its parent, by the registration's posterior, which is
    not calibrated and is too sure for thighs (12 degrees off at 3 were seen in simulations); NaN where unknown.
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


@contextmanager
def write_poses(path: Path) -> Iterator[RowGroups[BodyPose]]:
    """Opens poses.parquet for writing, frame by frame; the same bytes for the same frames."""
    with open_parquet(path, POSES_SCHEMA) as writer:
        poses = RowGroups(writer, _to_table, FRAMES_PER_ROW_GROUP)
        yield poses
        poses.flush()


def read_poses(path: Path) -> PoseTable:
    """A poses.parquet; raises InputError unless every frame has its 21 bones, in their order."""
    frame, time_s, numbers = from_rows(path, POSES_SCHEMA, MOVING_BONES)
    return PoseTable(frame, time_s, numbers[..., :3], numbers[..., 3:7], numbers[..., 7])


def _to_table(poses: Sequence[BodyPose]) -> pa.Table:
    numbers = np.stack([np.column_stack([p.head_m, p.quaternion, p.axial_sigma_rad]) for p in poses])
    numbers = numbers.astype(np.float32)
    return to_rows(POSES_SCHEMA, MOVING_BONES, [p.frame for p in poses], [p.time_s for p in poses], numbers)


def pose_of(asset: BodyAsset, head_m: np.ndarray, quaternion: np.ndarray) -> Pose:
    """The body's pose in a frame of the table: ``ShapedBody.bone_transforms`` makes every bone's place of it.

    head_m (21, 3), quaternion (21, 4) of one frame, in which the patient is not lost. Bones that do not move keep
    their rest pose. Raises ValueError for a lost frame.
    """
    if not (np.isfinite(head_m).all() and np.isfinite(quaternion).all()):
        raise ValueError("the patient is lost in this frame, so he has no pose")
    turned = Rotation.from_quat(quaternion.astype(np.float64), scalar_first=True).as_matrix()
    row_of = {asset.bone(name): row for row, name in enumerate(MOVING_BONES)}
    in_world, relative = list[np.ndarray](), list[np.ndarray]()
    for bone, parent in enumerate(asset.bone_parents.tolist()):
        above = in_world[parent] if parent >= 0 else np.eye(3)
        in_world.append(turned[row_of[bone]] if bone in row_of else above)
        relative.append(above.T @ in_world[bone])
    return Pose(np.stack(relative), head_m[MOVING_BONES.index("Hips")].astype(np.float64))
