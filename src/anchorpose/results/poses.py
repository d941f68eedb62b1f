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
from anchorpose.errors import InputError
from anchorpose.results.tables import FRAMES_PER_ROW_GROUP, RowGroups, open_parquet, read_parquet

POSES_FILE: Final = "poses.parquet"

_NUMBERS: Final = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz", "axial_sigma_rad")

POSES_SCHEMA: Final = pa.schema(
    [
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("time_s", pa.float64(), nullable=False),
        pa.field("bone", pa.string(), nullable=False),
        *(pa.field(name, pa.float32()) for name in _NUMBERS),
    ]
)

BONES: Final = len(MOVING_BONES)


@dataclass(frozen=True, slots=True, eq=False)
class BodyPose:
    """The learnt body in one frame, bones in the order of ``MOVING_BONES``; all NaN where the patient is lost.

    head_m (21, 3): the bone's head, world. quaternion (21, 4): w, x, y, z of the turn from the rest pose, whose axes
    are X forward, Y up and Z to the right, to the world; w is not negative. axial_sigma_rad (21,): one standard
    deviation of the turn about the bone's own long axis against its parent, by the registration's posterior; NaN where
    unknown.
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
    table = read_parquet(path, POSES_SCHEMA)
    frames, left = divmod(len(table), BONES)
    if left or table["bone"].to_pylist() != list(MOVING_BONES) * frames:
        raise InputError(path, f"has frames without exactly {BONES} bones", "track the recording again")
    numbers = np.stack([table[name].to_numpy(zero_copy_only=False) for name in _NUMBERS], axis=1)
    numbers = numbers.reshape(frames, BONES, len(_NUMBERS))
    return PoseTable(
        frame=table["frame"].to_numpy()[::BONES],
        time_s=table["time_s"].to_numpy()[::BONES],
        head_m=numbers[..., :3],
        quaternion=numbers[..., 3:7],
        axial_sigma_rad=numbers[..., 7],
    )


def _to_table(poses: Sequence[BodyPose]) -> pa.Table:
    numbers = np.concatenate(
        [np.column_stack([pose.head_m, pose.quaternion, pose.axial_sigma_rad]) for pose in poses]
    ).astype(np.float32)
    columns = [
        pa.array(np.repeat(np.array([pose.frame for pose in poses], np.int32), BONES)),
        pa.array(np.repeat(np.array([pose.time_s for pose in poses], np.float64), BONES)),
        pa.array(MOVING_BONES * len(poses), pa.string()),
        *(pa.array(numbers[:, column], pa.float32(), from_pandas=True) for column in range(len(_NUMBERS))),
    ]
    return pa.Table.from_arrays(columns, schema=POSES_SCHEMA)


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
