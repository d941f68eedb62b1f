"""What an export is made from: the tables of a results folder, read once and checked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, LOST, JointState
from anchorpose.results.run_record import hash_files
from anchorpose.results.tables import ANGLES_FILE, JOINTS_FILE, JointTable, read_angles, read_joints

STATES: Final = tuple(str(state) for state in JointState)
"""In the order of the codes 0 (observed) to 6 (lost) that formats without texts write."""


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """The same things measured in every frame: joints and angles on one clock.

    time_s (n,) float64, increasing; position_m (n, 21, 3) world, NaN where missing; joint_sigma_m (n, 21);
    joint_state_code (n, 21) int8, index into ``STATES``; degrees, sigma_deg, angle_state_code (n, a), of ``angles``.
    """

    time_s: np.ndarray
    position_m: np.ndarray
    joint_sigma_m: np.ndarray
    joint_state_code: np.ndarray
    angles: tuple[str, ...]
    degrees: np.ndarray
    sigma_deg: np.ndarray
    angle_state_code: np.ndarray

    def rows(self, rows: slice) -> Samples:
        """The samples of some frames."""
        arrays = {name: getattr(self, name)[rows] for name in self.__slots__ if name != "angles"}
        return replace(self, **arrays)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """A results folder as an export needs it; sha256: name and hash of each of its tables, in order of name."""

    folder: Path
    frame: np.ndarray  # (n,) int32
    samples: Samples
    sha256: tuple[tuple[str, str], ...]


def read_source(folder: Path) -> Source:
    """Joints and, where they are there, angles; raises InputError where it is no result or its times go back."""
    if not folder.is_dir():
        raise InputError(folder, "there is no such folder", "give a results folder made by 'anchorpose track'")
    joints = read_joints(folder / JOINTS_FILE)
    if not (np.isfinite(joints.time_s).all() and (np.diff(joints.time_s) > 0).all()):
        raise InputError(folder / JOINTS_FILE, "its times do not increase from frame to frame", "track again")
    names, degrees, sigma_deg, state_code = _angles(folder / ANGLES_FILE, joints)
    samples = Samples(
        joints.time_s, joints.position_m, joints.sigma_m, joints.state_code, names, degrees, sigma_deg, state_code
    )
    return Source(folder, joints.frame, samples, hash_files(sorted(folder.glob("*.parquet")), folder))


def _angles(path: Path, joints: JointTable) -> tuple[tuple[str, ...], np.ndarray, np.ndarray, np.ndarray]:
    """Names in the order of the table, and (n, a) degrees, sigma and state_code on the frames of the joints."""
    if not path.exists():
        empty = np.empty((len(joints.frame), 0))
        return (), empty, empty, empty.astype(np.int8)
    angles = read_angles(path)
    row = np.searchsorted(joints.frame, angles.frame)
    if not np.array_equal(joints.frame[np.minimum(row, len(joints.frame) - 1)], angles.frame):
        raise InputError(
            path, f"holds frames that {JOINTS_FILE} has not", "run 'anchorpose measure' on its folder again"
        )
    shape = (len(joints.frame), len(angles.names))
    degrees, sigma_deg, state_code = np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, LOST, np.int8)
    degrees[row], sigma_deg[row], state_code[row] = angles.degrees, angles.sigma_deg, angles.state_code
    return angles.names, degrees, sigma_deg, state_code


def missing_share(samples: Samples) -> float:
    """Share of joints times frames without a position."""
    return float(np.isnan(samples.position_m[..., 0]).sum() / (len(samples.time_s) * JOINT_COUNT))
