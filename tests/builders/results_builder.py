"""Results made up for the tests: a walking stick figure, with noise and states as asked for."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from anchorpose.isolation.depth_noise import DepthNoise
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES, JointState
from anchorpose.results.explained import EXPLAINED_FILE, PART_NAMES, ExplainedFrame, write_explained
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.run_record import RUN_FILE, CameraRecord, DepthRecord, DroppedFrame, RunRecord, write_run_record
from anchorpose.results.tables import ANGLES_FILE, JOINTS_FILE, JointFrame, read_joints, write_angles, write_joints

NOISE = DepthNoise((2.0, 3.0), (0.0064, 0.0144), (1.26, None), 49.0, holes=0.0123)


def standing_joints() -> np.ndarray:
    """(21, 3) metres: upright, arms and legs straight down, facing X."""
    place = {
        "SpineBase": (0, 0.95, 0),
        "SpineMid": (0, 1.15, 0),
        "SpineShoulder": (0, 1.42, 0),
        "Neck": (0, 1.5, 0),
        "Head": (0, 1.62, 0),
    }
    for side, z in (("Left", -1), ("Right", 1)):
        place |= {
            f"{name}{side}": (0, y, 0.18 * z)
            for name, y in (("Shoulder", 1.4), ("Elbow", 1.1), ("Wrist", 0.85), ("Hand", 0.77))
        }
        place |= {f"{name}{side}": (0, y, 0.09 * z) for name, y in (("Hip", 0.92), ("Knee", 0.5), ("Ankle", 0.08))}
        place[f"Foot{side}"] = (0.15, 0.03, 0.09 * z)
    return np.array([place[name] for name in JOINT_NAMES], dtype=np.float64)


def make_frame(
    frame: int,
    time_s: float,
    position_m: np.ndarray,
    lost: tuple[str, ...] = (),
    sigma_m: float = 0.02,
    states: Mapping[str, JointState] | None = None,
) -> JointFrame:
    """A frame in which all joints are observed but the lost ones and those of other ``states``."""
    position, sigma = position_m.copy(), np.full(JOINT_COUNT, sigma_m)
    state = [(states or {}).get(name, JointState.OBSERVED) for name in JOINT_NAMES]
    for name in lost:
        row = JOINT_INDEX[name]
        position[row], sigma[row], state[row] = np.nan, np.nan, JointState.LOST
    return JointFrame(frame=frame, time_s=time_s, position_m=position, state=tuple(state), sigma_m=sigma)


def write_results(folder: Path, frames: list[JointFrame]) -> Path:
    """A results folder without a report."""
    folder.mkdir(parents=True, exist_ok=True)
    with write_joints(folder / JOINTS_FILE) as joints:
        for frame in frames:
            joints.append(frame)
    write_angles(folder / ANGLES_FILE, joint_angles(read_joints(folder / JOINTS_FILE)))
    record = RunRecord(
        recording="<ward> & garden",
        config={"gate_m": 0.05},
        inputs_sha256={"recording.json": "0" * 64},
        cameras=(CameraRecord("front", np.eye(4), "given", depth=DepthRecord(NOISE, 0.0008, 2.0)),),
        frame_count=len(frames),
        dropped=(DroppedFrame(3, 0.3, "front/depth/000003.png is truncated"),),
        notes=("The floor was found <by itself>.",),
    )
    write_run_record(folder / RUN_FILE, record)
    return folder


def explained_frames(
    uncovered_cm2: Sequence[float], past: Mapping[tuple[int, str], float], fps: float
) -> list[ExplainedFrame]:
    """One frame per area; past: share that a camera sees past by frame and part, 0 for the others, NaN where lost."""
    return [
        ExplainedFrame(frame, frame / fps, area, np.array([past.get((frame, name), 0.0 * area) for name in PART_NAMES]))
        for frame, area in enumerate(uncovered_cm2)
    ]


def write_explained_frames(folder: Path, frames: Sequence[ExplainedFrame]) -> None:
    """explained.parquet of a results folder."""
    with write_explained(folder / EXPLAINED_FILE) as table:
        for frame in frames:
            table.append(frame)
