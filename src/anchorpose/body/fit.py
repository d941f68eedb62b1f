"""Fit the pose (and shape) of the articulated body to constraint rows (linear equations on its skin points) by
Gauss-Newton steps. The ranges in which people's joints bend serve as priors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numba import njit
from scipy.linalg.lapack import dposv

from anchorpose.body.constraints import Constraints
from anchorpose.body.explanation import segment_of_points
from anchorpose.body.joint_ranges import JointRange, joint_range_at
from anchorpose.body.pose import DEGREE, PARTS, POSE_SIZE, SEGMENT_OF_BONES, Pose
from anchorpose.body.pose_accumulation import accumulate_pose
from anchorpose.body.shape_rows import FreeShape, accumulate_shape
from anchorpose.body.skin_points import Body, PosedPoints, SkinPoints, pose_points
from anchorpose.rotations import inverse_left_jacobian

# rad, standard deviation of the angle by which a knee, elbow or hip bends beyond its limit
HINGE_LIMIT_SIGMA: Final = 3.0 * DEGREE
# minimum number of observations for the upper or lower part of a limb to count as seen; a single observation may be an
# outlier
LEAST_OBSERVED: Final = 2.0
MAX_TURN: Final = 30.0 * DEGREE  # rad, maximum turn of a bone about each axis in one step of the solver

Predicted = tuple[Pose, np.ndarray]
"""A predicted pose and its inverse covariance (POSE_SIZE, POSE_SIZE)."""


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """The system ``hessian @ change = -gradient`` for a change of parameters: first the pose parameters, then the shape
    parameters.
    """

    hessian: np.ndarray
    gradient: np.ndarray
    cost: float  # sum, over observations and priors, of squared deviations divided by their variances


def pose_equations(
    body: Body,
    pose: Pose,
    posed: PosedPoints,
    constraints: Constraints,
    prior: NormalEquations,
    rows_per_observation: float,
    free: FreeShape | None = None,
) -> NormalEquations:
    """Return the normal equations of one frame from its constraint rows and the prior.

    prior: the prior on the pose, from ``prior_equations``. free: the numbers of shape parameters that are fitted
    together with the pose; None: only the pose is fitted.
    """
    size = POSE_SIZE + (0 if free is None else sum(free))
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    hessian[:POSE_SIZE, :POSE_SIZE], gradient[:POSE_SIZE] = prior.hessian, prior.gradient
    residual = constraints.residuals(posed)
    weight = constraints.weights(residual) / rows_per_observation
    if free is None:
        of_rows = accumulate_pose(body, posed, constraints.point, constraints.direction, residual, weight)
    else:
        of_rows = accumulate_shape(body, posed, constraints, residual, weight, free)
    hessian += of_rows[0]
    gradient += of_rows[1]
    scaled = (residual / constraints.scale_m) ** 2
    robust = (constraints.scale_m / constraints.sigma_m) ** 2 * scaled / (1.0 + scaled)
    cost = float(robust.sum()) / rows_per_observation
    return NormalEquations(hessian, gradient, cost + prior.cost)


def hidden_bones(points: SkinPoints, rows: Constraints, rows_per_observation: float) -> tuple[int, ...]:
    """Return the bones of the hidden parts of limbs, as indices into ``MOVING_BONES``. A limb has two parts, divided at
    the elbow or knee. A part is hidden if fewer than ``LEAST_OBSERVED`` observations lie on it.
    """
    observed = np.bincount(segment_of_points(points)[rows.point], minlength=2 * PARTS) / rows_per_observation
    return _bones_of_segments(tuple((observed < LEAST_OBSERVED).tolist()))


@cache
def _bones_of_segments(hidden: tuple[bool, ...]) -> tuple[int, ...]:
    return tuple(row for row, segment in enumerate(SEGMENT_OF_BONES) if segment >= 2 and hidden[segment])


def prior_equations(
    points: SkinPoints, pose: Pose, predicted: Predicted | None, hidden: tuple[int, ...] | None = None
) -> NormalEquations:
    """Return the equations of the prior on a pose: the usual range of each joint, the limits to the bending of elbows,
    knees and hips, and the predicted pose if given. hidden: indices of the hidden bones in ``MOVING_BONES``; if None,
    all bones follow the statistics of motion capture.
    """
    ranges = joint_range_at(points.asset, pose, hidden)
    hessian, gradient, cost = _range_equations(pose.rotation_vectors(points.moving), ranges)
    if predicted is not None:
        expected, information = predicted
        away = expected.change_to(pose, points.moving)
        hessian += information
        pull = information @ away
        gradient += pull
        cost += float(away @ pull)
    return NormalEquations(hessian, gradient, cost)


def range_information(points: SkinPoints, pose: Pose, hidden: tuple[int, ...]) -> np.ndarray:
    """Return the inverse covariance (POSE_SIZE, POSE_SIZE) that a pose has without any observation, if only the usual
    ranges of the joints and the limits to the bending of elbows, knees and hips are known.
    """
    return prior_equations(points, pose, None, hidden).hessian


@njit(cache=True, nogil=True)
def _coupled(information: np.ndarray, m: int, n: int) -> bool:
    """Return whether an inverse covariance (m, 3, m, 3) couples the two bones with the indices m and n, that is, has an
    entry other than 0 for this pair of bones.
    """
    for i in range(3):
        for j in range(3):
            if information[m, i, n, j] != 0.0:
                return True
    return False


@njit(cache=True, nogil=True)
def _range_equations(vectors: np.ndarray, ranges: JointRange) -> tuple[np.ndarray, np.ndarray, float]:
    """Return Hessian, gradient and value of the cost that keeps joints in their usual range: the squared deviation of
    each bone's turn from the mean of ``ranges``, and the squared angle by which an elbow, knee or hip exceeds
    its limit.

    vectors (m, 3): the bones' rotation vectors, radians.
    """
    count = len(vectors)
    hessian, gradient, cost = np.zeros((3 * count + 3, 3 * count + 3)), np.zeros(3 * count + 3), 0.0
    change, away, slope = np.empty((count, 3, 3)), vectors - ranges.mean, np.empty((3, 3))
    bend = np.empty(3)
    for m in range(count):
        inverse_left_jacobian(vectors[m], change[m])
    for m in range(count):
        for n in range(count):
            if not _coupled(ranges.information, m, n):
                continue
            for i in range(3):
                for j in range(3):
                    slope[i, j] = 0.0
                    for k in range(3):
                        slope[i, j] += ranges.information[m, i, n, k] * change[n, k, j]
            for i in range(3):
                for j in range(3):
                    pull = ranges.information[m, j, n, i] * away[n, i]
                    cost += away[m, j] * pull
                    for k in range(3):
                        gradient[3 * m + k] += change[m, j, k] * pull
                        hessian[3 * m + k, 3 * n + i] += change[m, j, k] * slope[j, i]
    for m in range(count):
        past = ranges.hinge_limit[m]
        for j in range(3):
            past -= vectors[m, j] * ranges.hinge[m, j]
        past /= HINGE_LIMIT_SIGMA
        if past > 0.0:
            cost += past * past
            for i in range(3):
                bend[i] = 0.0
                for j in range(3):
                    bend[i] -= ranges.hinge[m, j] * change[m, j, i] / HINGE_LIMIT_SIGMA
            for i in range(3):
                gradient[3 * m + i] += bend[i] * past
                for j in range(3):
                    hessian[3 * m + i, 3 * m + j] += bend[i] * bend[j]
    return hessian, gradient, cost


def solve_damped(equations: NormalEquations) -> np.ndarray:
    """Return the Gauss-Newton change with slight Marquardt damping (doi:10.1137/0111030).

    Parameters without observations, such as the place of a body that is not near any node, do not change.
    """
    diagonal = np.diag(equations.hessian)
    hessian = equations.hessian + np.diag(np.where(diagonal == 0.0, 1.0, 1e-3 * diagonal))
    _, change, failed = dposv(hessian, -equations.gradient)
    if failed:
        raise np.linalg.LinAlgError(f"the normal equations are not positive definite, LAPACK reports {failed}")
    return np.asarray(change)


def limited(change: np.ndarray) -> np.ndarray:
    """Return the change of a pose, scaled down so that no bone turns farther than ``MAX_TURN`` about any axis."""
    largest = np.abs(change[: POSE_SIZE - 3]).max()
    return change * min(1.0, MAX_TURN / largest) if largest > 0 else change


def damped_step(
    body: Body, pose: Pose, rows: Constraints, predicted: Predicted | None, rows_per_observation: float
) -> Pose:
    """Return the pose after one Gauss-Newton step.

    Without a prediction (``predicted`` is None), constraint rows may pull a limb to another limb's surface. So the rows
    of a limb do not prove that the limb is seen, and all limbs have the joint ranges of hidden limbs (``joint_range``).
    """
    hidden = None if predicted is None else hidden_bones(body.points, rows, rows_per_observation)
    prior = prior_equations(body.points, pose, predicted, hidden)
    equations = pose_equations(body, pose, pose_points(body, pose), rows, prior, rows_per_observation)
    return pose.moved(limited(solve_damped(equations)), body.points.moving)
