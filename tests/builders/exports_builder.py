"""Results to export: true joints of a simulated person written as a results folder, without any tracking."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from results_builder import make_frame, write_results

from anchorpose.exports.formats import Samples
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JointState
from anchorpose.results.tables import POSES_FILE, BodyPose, write_poses
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import single

FPS = 15.0


@cache
def true_joints(motion: str = "squat", seed: int = 3, seconds: float = 5.0) -> np.ndarray:
    """(n, 21, 3) metres, world: what ``anchorpose simulate --preset single`` of this seed writes as its truth."""
    clinic = draw_clinic(replace(single(seed, seconds, FPS), motions=(motion,)))
    joints = clinic.act(np.arange(round(seconds * FPS)) / FPS).joints_m()
    joints.setflags(write=False)
    return joints


def times(count: int) -> np.ndarray:
    """(n,) as a recording has them: to the microsecond."""
    return np.round(np.arange(count) / FPS, 6)


def write_true_results(
    folder: Path,
    joints: np.ndarray,
    time_s: np.ndarray | None = None,
    lost: Mapping[int, tuple[str, ...]] | None = None,
) -> Path:
    """Joints (n, 21, 3) as results; lost: names of joints by row."""
    stamps = times(len(joints)) if time_s is None else time_s
    states = {"HandLeft": JointState.HIDDEN_BY_PERSON}
    frames = [
        make_frame(row, float(stamps[row]), place, (lost or {}).get(row, ()), 0.004 + 0.0001 * row, states)
        for row, place in enumerate(joints)
    ]
    return write_results(folder, frames)


def write_all_poses(folder: Path, poses: Sequence[BodyPose]) -> None:
    with write_poses(folder / POSES_FILE) as table:
        for pose in poses:
            table.append(pose)


def make_samples(time_s: np.ndarray) -> Samples:
    """Samples with one angle; every coordinate moves at 1 m/s and the angle at 10 degrees a second."""
    count = len(time_s)
    position_m = np.broadcast_to(time_s[:, None, None], (count, JOINT_COUNT, 3)).copy()
    return Samples(
        time_s=time_s,
        position_m=position_m,
        joint_sigma_m=np.full((count, JOINT_COUNT), 0.01),
        joint_state_code=np.where(np.isnan(position_m[..., 0]), 6, 0).astype(np.int8),
        angles=("knee_flexion_left",),
        degrees=10.0 * time_s[:, None],
        sigma_deg=np.full((count, 1), 2.0),
        angle_state_code=np.zeros((count, 1), np.int8),
    )


def column(name: str) -> int:
    return JOINT_INDEX[name]


def angle_of(results: Path, name: str) -> np.ndarray:
    """(n,) degrees of an angle, as angles.parquet has it; NaN where it is null."""
    rows = [row for row in pq.read_table(results / "angles.parquet").to_pylist() if row["angle"] == name]
    return np.array([np.nan if row["degrees"] is None else row["degrees"] for row in rows])


def angle_names(results: Path) -> list[str]:
    return list(dict.fromkeys(pq.read_table(results / "angles.parquet")["angle"].to_pylist()))
