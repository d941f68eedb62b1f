"""How far off each joint may be: the posterior of the registration, carried to the joints and calibrated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.body.asset import joint_bones
from anchorpose.body.skin_points import Body, PosedPoints, joint_jacobian


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertaintyConfig:
    """What the linear posterior does not know, set on simulated people alone and in clinics (see docs/tracking.md)."""

    floor_m: float = 0.0035  # joints lie inside the body; the learnt shape places them no better than this
    inflation: float = 0.65  # of the posterior: rows_per_observation is cautious, neighbours err less alike than that

    def __post_init__(self) -> None:
        if not (self.floor_m > 0 and self.inflation > 0):
            raise ValueError("floor_m and inflation must be positive")


def joint_sigma(body: Body, posed: PosedPoints, covariance: np.ndarray, config: UncertaintyConfig) -> np.ndarray:
    """(21,) one standard deviation of the position error per axis, metres.

    covariance (POSE_SIZE, POSE_SIZE): of the pose, inverse of the normal equations' hessian.
    """
    places = body.mesh.joints(posed.transforms)
    variance = _variance(body, posed, covariance, joint_bones(body.points.asset), places)
    return np.sqrt(config.floor_m**2 + config.inflation**2 * variance)


def skin_sigma(body: Body, posed: PosedPoints, covariance: np.ndarray, config: UncertaintyConfig) -> np.ndarray:
    """(p,) the same of skin points: that of the middle of the part which each moves with."""
    count = np.bincount(body.points.part)
    parts = np.flatnonzero(count)
    middles = np.stack([np.bincount(body.points.part, posed.points_m[:, axis]) for axis in range(3)], axis=1)
    variance = np.zeros(len(count))
    variance[parts] = _variance(body, posed, covariance, parts, middles[parts] / count[parts, None])
    return np.sqrt(config.floor_m**2 + config.inflation**2 * variance[body.points.part])


def _variance(
    body: Body, posed: PosedPoints, covariance: np.ndarray, bones: np.ndarray,
    places_m: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """(n,) mean variance of the three axes, square metres, of places_m (n, 3) that are fixed to bones (n,)."""
    jacobian = joint_jacobian(body, posed.transforms, bones, places_m)
    return np.asarray(((jacobian @ covariance) * jacobian).sum(axis=(1, 2)) / 3.0)
