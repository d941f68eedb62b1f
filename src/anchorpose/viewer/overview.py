"""All frames at a glance: a few numbers of each, so that hours of them open at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_COUNT, STATE_CODE, JointState
from anchorpose.results.frame_table import StoredFrames
from anchorpose.results.tables import JointTable

AT_ONCE: Final = 4096  # frames
SAMPLED: Final = 2000  # frames that the middle of the view is taken from


@dataclass(frozen=True, slots=True, eq=False)
class Overview:
    """One row per frame of the results.

    observed (n,) uint8: number of joints that are observed. lost (n, 21) bool. worst_sigma_m (n,) float64: the largest
    sigma of a joint, and worst_joint (n,) int64 which joint has it; NaN and 0 where all are lost. middle_m (3,): the
    patient's median position, world, and lowest_m the height of the lowest joint; None where all is lost.
    """

    frame: np.ndarray
    time_s: np.ndarray
    observed: np.ndarray
    lost: np.ndarray
    worst_sigma_m: np.ndarray
    worst_joint: np.ndarray
    middle_m: np.ndarray | None
    lowest_m: float | None


def overview_of(joints: StoredFrames[JointTable]) -> Overview:
    """Reads all joints once, some frames at a time."""
    count = len(joints.frame)
    observed, lost = np.zeros(count, np.uint8), np.zeros((count, JOINT_COUNT), bool)
    worst_sigma_m, worst_joint = np.full(count, np.nan), np.zeros(count, np.int64)
    places, lowest, step = list[np.ndarray](), np.inf, max(1, count // SAMPLED)
    for rows, table in joints.blocks(AT_ONCE):
        observed[rows] = (table.state_code == STATE_CODE[JointState.OBSERVED]).sum(axis=1)
        lost[rows] = table.lost
        sigma_m = np.where(np.isnan(table.sigma_m), -np.inf, table.sigma_m)
        worst_joint[rows] = sigma_m.argmax(axis=1)
        worst = sigma_m.max(axis=1)
        worst_sigma_m[rows] = np.where(np.isfinite(worst), worst, np.nan)
        places.append(table.position_m[::step].reshape(-1, 3))
        lowest = min(lowest, float(np.nanmin(table.position_m[..., 1], initial=np.inf)))
    seen = np.concatenate([np.empty((0, 3)), *places])
    seen = seen[np.isfinite(seen).all(axis=1)]
    known = len(seen) > 0 and bool(np.isfinite(lowest))
    return Overview(
        frame=joints.frame,
        time_s=joints.time_s,
        observed=observed,
        lost=lost,
        worst_sigma_m=worst_sigma_m,
        worst_joint=worst_joint,
        middle_m=np.median(seen, axis=0) if known else None,
        lowest_m=lowest if known else None,
    )
