"""Standard deviation of each joint: the posterior of the registration, propagated to the joints and calibrated."""

from __future__ import annotations

import numpy as np

from anchorpose.body.asset import joint_bones
from anchorpose.body.config import UncertaintyConfig
from anchorpose.body.skin_points import Body, PosedPoints, joint_jacobian


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
    body: Body, posed: PosedPoints, covariance: np.ndarray, bones: np.ndarray, places_m: np.ndarray
) -> np.ndarray:
    """(n,) mean variance of the three axes, square metres, of places_m (n, 3) that are fixed to bones (n,)."""
    jacobian = joint_jacobian(body, posed.transforms, bones, places_m)
    return np.asarray(((jacobian @ covariance) * jacobian).sum(axis=(1, 2)) / 3.0)
