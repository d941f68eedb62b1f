"""How far the joint angles are from those of the true joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.results.kinematics.joint_angles import joint_angles
from anchorpose.results.tables import JointTable

NORMAL_95: Final = 1.96
"""Standard deviations within which 95 of 100 values of a normal distribution lie."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleError:
    """Of one angle; None where no frame has both it and its truth."""

    frames: int
    mean_abs_deg: float | None
    p95_deg: float | None
    coverage_95: float | None  # share of frames in which the truth lies within 1.96 sigma; honest is 0.95


def angle_errors(joints: JointTable, truth_m: np.ndarray) -> tuple[tuple[str, AngleError], ...]:
    """Each angle's error; truth_m (n, 21, 3) true joints, metres, of the frames of ``joints``, NaN where unknown."""
    found = joint_angles(joints)
    exact = np.zeros_like(joints.sigma_m)
    true = joint_angles(JointTable(joints.frame, joints.time_s, truth_m, joints.severity, exact))
    away = np.radians(found.degrees - true.degrees)
    error = np.degrees(np.abs(np.arctan2(np.sin(away), np.cos(away))))
    within = error <= NORMAL_95 * found.sigma_deg
    return tuple((name, _summary(error[:, column], within[:, column])) for column, name in enumerate(found.names))


def _summary(error_deg: np.ndarray, within: np.ndarray) -> AngleError:
    known, covered = error_deg[np.isfinite(error_deg)], within[np.isfinite(error_deg)]
    some = len(known) > 0
    return AngleError(
        frames=len(known),
        mean_abs_deg=float(known.mean()) if some else None,
        p95_deg=float(np.percentile(known, 95)) if some else None,
        coverage_95=float(covered.mean()) if some else None,
    )
