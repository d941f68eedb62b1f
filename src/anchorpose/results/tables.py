"""Define the results tables that have the same rows in every frame: joints, anchors, bones, angles, posture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset
from anchorpose.body.pose import MOVING_BONES, Pose
from anchorpose.errors import InputError
from anchorpose.joints import ANCHOR_NAMES, JOINT_COUNT, JOINT_NAMES, LOST, STATE_CODE, JointState
from anchorpose.recording.recording_file import FARTHEST_CAMERA_M
from anchorpose.results.frame_table import Codes, Column, Flags, FrameTable, Numbers, cut_rows
from anchorpose.results.parquet import MEASURE_AGAIN, TRACK_AGAIN, read_parquet_schema

_STATES: Final = tuple(str(state) for state in JointState)

LARGEST_DEG: Final = 360.0
LARGEST_SIGMA: Final = 1e6
"""Maximum sigma (m, degrees or radians). The limit is large, since an angle that the pose hardly determines may have a
sigma of many full rotations.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointFrame:
    """The 21 joints at one time of the reference clock, in the order of ``JOINT_NAMES`` and in world coordinates.

    position_m (21, 3) float64, NaN for lost joints; sigma_m (21,) float64, one standard deviation along each axis, NaN
    for lost joints. Raises ValueError if position, sigma and state disagree: a lost joint must have neither position
    nor sigma, and any other joint must have both.
    """

    frame: int
    time_s: float
    position_m: np.ndarray
    state: tuple[JointState, ...]
    sigma_m: np.ndarray

    def __post_init__(self) -> None:
        if self.position_m.shape != (JOINT_COUNT, 3) or self.sigma_m.shape != (JOINT_COUNT,):
            raise ValueError(f"position_m is {self.position_m.shape} and sigma_m {self.sigma_m.shape}, not 21 joints")
        if len(self.state) != JOINT_COUNT:
            raise ValueError(f"{len(self.state)} states given for {JOINT_COUNT} joints")
        agree = _numbers_agree(self)
        if not agree.all():
            wrong = int(np.flatnonzero(~agree)[0])
            raise ValueError(
                f"frame {self.frame}, joint {wrong}: position, sigma and state {self.state[wrong]} disagree"
            )

    @property
    def state_code(self) -> np.ndarray:
        """Return (21,) int8: the code (``STATE_CODE``) of each joint's state."""
        return np.array([STATE_CODE[state] for state in self.state], dtype=np.int8)


@dataclass(frozen=True, slots=True, eq=False)
class JointTable:
    """The joints in all frames of a result. A joint without a position has NaN and the state ``lost``.

    frame (n,) int32, time_s (n,) float64, position_m (n, 21, 3) float64 world, state_code (n, 21) int8 index into
    ``JointState``, sigma_m (n, 21) float64.
    """

    frame: np.ndarray
    time_s: np.ndarray
    position_m: np.ndarray
    state_code: np.ndarray
    sigma_m: np.ndarray

    @property
    def lost(self) -> np.ndarray:
        """Return (n, 21) bool: True for lost joints."""
        return self.state_code == LOST

    def frames(self, chosen: slice | np.ndarray) -> JointTable:
        """Return the table of the chosen frames."""
        return cut_rows(self, chosen)


def _numbers_agree(joints: JointFrame | JointTable) -> np.ndarray:
    """Return (..., 21) bool: whether position and sigma are missing for lost joints, and complete for other joints."""
    known = np.isfinite(joints.position_m).all(axis=-1) & np.isfinite(joints.sigma_m) & (joints.sigma_m > 0)
    blank = np.isnan(joints.position_m).all(axis=-1) & np.isnan(joints.sigma_m)
    return np.where(joints.state_code == LOST, blank, known)


JOINTS: Final = FrameTable(
    file="joints.parquet",
    arrays=JointTable,
    thing="joint",
    names=JOINT_NAMES,
    columns={
        "position_m": Numbers(("x_m", "y_m", "z_m"), -FARTHEST_CAMERA_M, FARTHEST_CAMERA_M),
        "state_code": Codes("state", _STATES),
        "sigma_m": Numbers(("sigma_m",), 0.0, FARTHEST_CAMERA_M),
    },
    agree=lambda joints: bool(_numbers_agree(joints).all()),
    remedy=TRACK_AGAIN,
)
JOINTS_FILE, read_joints, write_joints = JOINTS.file, JOINTS.read, JOINTS.open


@dataclass(frozen=True, slots=True, eq=False)
class AnchorFrame:
    """Head, hands and feet in one frame: position_m (5, 3) world and sigma_m (5,), in the order of ``ANCHOR_NAMES``.

    Anchors are the geodesic extrema of the patient's surface, the points at the ends of head, arms and legs; they are
    not joints. An anchor that was not found is NaN.
    """

    frame: int
    time_s: float
    position_m: np.ndarray
    sigma_m: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class AnchorTable:
    """The anchors of all frames: frame (n,) int32, time_s (n,), position_m (n, 5, 3), sigma_m (n, 5) float64, NaN for
    anchors that were not found.
    """

    frame: np.ndarray
    time_s: np.ndarray
    position_m: np.ndarray
    sigma_m: np.ndarray


ANCHORS: Final = FrameTable(
    file="anchors.parquet",
    arrays=AnchorTable,
    thing="anchor",
    names=ANCHOR_NAMES,
    columns={
        "position_m": Numbers(("x_m", "y_m", "z_m"), -FARTHEST_CAMERA_M, FARTHEST_CAMERA_M),
        "sigma_m": Numbers(("sigma_m",), 0.0, FARTHEST_CAMERA_M),
    },
    remedy=TRACK_AGAIN,
)
ANCHORS_FILE, read_anchors, write_anchors = ANCHORS.file, ANCHORS.read, ANCHORS.open


@dataclass(frozen=True, slots=True, eq=False)
class AngleTable:
    """The angles of all frames. frame (n,) int32, time_s (n,) float64, names (a,): the angles' names in docs/angles.md.
    The angles are defined in ``angle_definition``.

    degrees and sigma_deg (n, a) float64, NaN where a joint is lost or the pose leaves the angle undetermined;
    state_code (n, a) int8 index into ``JointState``, the worst of the joints involved.
    """

    frame: np.ndarray
    time_s: np.ndarray
    names: tuple[str, ...]
    degrees: np.ndarray
    state_code: np.ndarray
    sigma_deg: np.ndarray

    def column(self, name: str) -> int:
        """Return the index of the angle ``name`` on the second axis; raises ValueError for an unknown name."""
        return self.names.index(name)


_ANGLE_COLUMNS: Final[dict[str, Column]] = {
    "degrees": Numbers(("degrees",), -LARGEST_DEG, LARGEST_DEG),
    "state_code": Codes("state", _STATES),
    "sigma_deg": Numbers(("sigma_deg",), 0.0, LARGEST_SIGMA),
}

ANGLES: Final = FrameTable(
    file="angles.parquet", arrays=AngleTable, thing="angle", columns=_ANGLE_COLUMNS, remedy=MEASURE_AGAIN
)
ANGLES_FILE, read_angles, write_angles = ANGLES.file, ANGLES.read, ANGLES.write


PROCESSING: Final = ("measured", "smoothed", "filled")
"""Ways in which joints are processed. An angle has the last of these ways that applies to any of its joints;
``ProcessedAngles.processing`` holds the index of this way.
"""


@dataclass(frozen=True, slots=True, eq=False)
class ProcessedAngles(AngleTable):
    """Angles of joints that were smoothed or whose gaps were filled.

    processing (n, a) int8 index into ``PROCESSING``: whether the angle was measured, smoothed or filled.
    """

    processing: np.ndarray


ANGLES_PROCESSED: Final = FrameTable(
    file="angles_processed.parquet",
    arrays=ProcessedAngles,
    thing="angle",
    columns={**_ANGLE_COLUMNS, "processing": Codes("processing", PROCESSING)},
    remedy=MEASURE_AGAIN,
)
PROCESSED_FILE, write_processed_angles = ANGLES_PROCESSED.file, ANGLES_PROCESSED.write

POLICY_KEY: Final = "processing_policy"  # key of the policy in the metadata of angles_processed.parquet


def read_processed_angles(path: Path) -> ProcessedAngles:
    """Read angles_processed.parquet; raises InputError as ``FrameTable.read`` does, and if the file's metadata do not
    state how the joints were processed.
    """
    angles = ANGLES_PROCESSED.read(path)
    if POLICY_KEY.encode() not in (read_parquet_schema(path).metadata or {}):
        raise InputError(path, f"has no '{POLICY_KEY}' in its metadata", MEASURE_AGAIN)
    return angles


NOT_UPRIGHT, UPRIGHT = 0, 1


@dataclass(frozen=True, slots=True, eq=False)
class PostureTable:
    """The estimated centre of mass of the whole body, and whether the patient is upright, in each frame.

    frame (n,) int32, time_s (n,) float64. com_m (n, 3) float64 world: the centre of mass, NaN if a joint that
    determines it is lost; com_sigma_m (n,) float64, one standard deviation along each axis. upright (n,) int8:
    ``UPRIGHT``, ``NOT_UPRIGHT`` or ``UNKNOWN``. state_code (n,) int8 index into ``JointState``: worst state of the
    joints used.
    """

    frame: np.ndarray
    time_s: np.ndarray
    com_m: np.ndarray
    com_sigma_m: np.ndarray
    upright: np.ndarray
    state_code: np.ndarray


POSTURE: Final = FrameTable(
    file="posture.parquet",
    arrays=PostureTable,
    columns={
        "com_m": Numbers(("com_x_m", "com_y_m", "com_z_m"), -FARTHEST_CAMERA_M, FARTHEST_CAMERA_M),
        "com_sigma_m": Numbers(("com_sigma_m",), 0.0, FARTHEST_CAMERA_M),
        "upright": Flags("upright"),
        "state_code": Codes("state", _STATES),
    },
    remedy=MEASURE_AGAIN,
)
POSTURE_FILE, read_posture, write_posture = POSTURE.file, POSTURE.read, POSTURE.write


@dataclass(frozen=True, slots=True, eq=False)
class BodyPose:
    """The pose, in one frame, of the body that was learnt from the recording. Bones are in the order of
    ``MOVING_BONES``; all values are NaN where the patient is lost.

    head_m (21, 3): the proximal end of each bone, about which it rotates, world. quaternion (21, 4): w, x, y, z of the
    rotation from the rest pose (X forward, Y up, Z to the right) to the world; w is not negative. axial_sigma_rad
    (21,): standard deviation of each bone's rotation about its long axis relative to its parent bone, from the
    covariance of the fitted pose; NaN where unknown. axial_sigma_rad is not calibrated; for example, thighs in
    simulations had errors of 12 degrees at a sigma of 3.
    """

    frame: int
    time_s: float
    head_m: np.ndarray
    quaternion: np.ndarray
    axial_sigma_rad: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class PoseTable:
    """The body's poses in all frames: frame (n,) int32, time_s (n,) float64, head_m (n, 21, 3), quaternion (n, 21, 4),
    axial_sigma_rad (n, 21), float32. ``BodyPose`` states their meaning.
    """

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
        "head_m": Numbers(("x_m", "y_m", "z_m"), -FARTHEST_CAMERA_M, FARTHEST_CAMERA_M, pa.float32()),
        "quaternion": Numbers(("qw", "qx", "qy", "qz"), -1.001, 1.001, pa.float32()),
        "axial_sigma_rad": Numbers(("axial_sigma_rad",), 0.0, LARGEST_SIGMA, pa.float32()),
    },
    remedy=TRACK_AGAIN,
)
POSES_FILE, read_poses, write_poses = POSES.file, POSES.read, POSES.open


def pose_of(asset: BodyAsset, head_m: np.ndarray, quaternion: np.ndarray) -> Pose:
    """Return the body's pose in one frame of the table; ``BodyMesh.bone_transforms`` gives the place of every bone.

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
