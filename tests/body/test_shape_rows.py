"""Compiled rows by pose, shape and clothes together: those of the reference implementation, and their products."""

import numpy as np
import pytest
from body_builder import adult, asset, points, random_pose, shape_jacobian, standing

from anchorpose.body.constraints import Constraints, no_constraints
from anchorpose.body.pose import POSE_SIZE, Pose
from anchorpose.body.shape_rows import FreeShape, accumulate_shape, full_jacobian
from anchorpose.body.skin_points import (
    CLOTHES,
    OFFSETS,
    POINT_COUNT,
    FittedShape,
    build_body,
    pose_jacobian,
    pose_points,
)

BENT = standing(LeftLeg=(0.0, 0.0, -80.0), RightForeArm=(0.0, 60.0, 20.0), Spine=(10.0, 20.0, -15.0))
POSES = [random_pose(1), random_pose(2, 0.8), BENT]
ALL = FreeShape(asset().shape_count, OFFSETS)
FREE = [
    ALL,
    FreeShape(asset().common_count, len(CLOTHES)),
    FreeShape(5, 0),
    FreeShape(asset().common_count + 3, 1),
    FreeShape(0, OFFSETS),
    FreeShape(0, 0),
]


def some_shape(seed: int) -> FittedShape:
    """An adult with segments, clothes and patches of his own."""
    rng = np.random.default_rng(seed)
    coefficients = adult(1.66).coefficients + rng.normal(0.0, 0.7, asset().shape_count)
    return FittedShape(coefficients, rng.uniform(0.0, 0.01, OFFSETS))


BODY = build_body(points(), some_shape(3))


def some_rows(seed: int, count: int = 400) -> Constraints:
    """Along random directions, also of the same point more than once."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return Constraints.alike(rng.integers(0, POINT_COUNT, count), rng.normal(size=(count, 3)), direction, 0.01, 0.03)


def reference(pose: Pose, rows: Constraints, free: FreeShape) -> np.ndarray:
    posed = pose_points(BODY, pose)
    by_shape = shape_jacobian(BODY, posed, rows.point, rows.direction, free.coefficients)
    by_pose = pose_jacobian(BODY, posed, rows.point, rows.direction)
    return np.hstack([by_pose, by_shape[:, : free.coefficients + free.offsets]])


@pytest.mark.parametrize("free", FREE, ids=str)
@pytest.mark.parametrize("pose", POSES, ids=["random", "wide", "bent"])
def test_the_compiled_rows_are_those_of_pose_and_shape_side_by_side(pose, free):
    rows = some_rows(4)
    found = full_jacobian(BODY, pose_points(BODY, pose), rows.point, rows.direction, free)
    assert found.shape == (len(rows), POSE_SIZE + sum(free))
    np.testing.assert_allclose(found, reference(pose, rows, free), atol=1e-12)


def test_every_skin_point_has_its_own_row():
    """Points of one to as many bones as there are influences, in order."""
    rng = np.random.default_rng(6)
    direction = rng.normal(size=(POINT_COUNT, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    rows = Constraints.alike(np.arange(POINT_COUNT), np.zeros((POINT_COUNT, 3)), direction, 0.01, 0.03)
    found = full_jacobian(BODY, pose_points(BODY, POSES[1]), rows.point, direction, ALL)
    np.testing.assert_allclose(found, reference(POSES[1], rows, ALL), atol=1e-12)


@pytest.mark.parametrize("free", FREE[:4], ids=str)
@pytest.mark.parametrize("pose", POSES, ids=["random", "wide", "bent"])
def test_accumulation_is_the_rows_multiplied_out(pose, free):
    rows, rng = some_rows(7, 700), np.random.default_rng(8)
    residual_m, weight = rng.normal(size=700), rng.uniform(0.0, 3.0, 700)
    weight[::5] = 0.0
    plain = reference(pose, rows, free)
    hessian, gradient = accumulate_shape(BODY, pose_points(BODY, pose), rows, residual_m, weight, free)
    np.testing.assert_allclose(hessian, plain.T @ (weight[:, None] * plain), atol=1e-9)
    np.testing.assert_allclose(gradient, plain.T @ (weight * residual_m), atol=1e-9)
    np.testing.assert_array_equal(hessian, hessian.T)


def test_accumulation_of_no_rows_is_zero():
    posed, nothing = pose_points(BODY, POSES[0]), np.zeros(0)
    hessian, gradient = accumulate_shape(BODY, posed, no_constraints(), nothing, nothing, ALL)
    assert hessian.shape == (POSE_SIZE + sum(ALL),) * 2
    assert not hessian.any()
    assert not gradient.any()


def test_what_is_seen_twice_counts_twice():
    rows, rng = some_rows(9, 200), np.random.default_rng(10)
    residual_m, weight = rng.normal(size=200), rng.uniform(0.0, 3.0, 200)
    posed = pose_points(BODY, POSES[0])
    twice = Constraints(*(np.repeat(getattr(rows, name), 2, axis=0) for name in Constraints.__slots__))
    once = accumulate_shape(BODY, posed, rows, residual_m, 2.0 * weight, ALL)
    again = accumulate_shape(BODY, posed, twice, np.repeat(residual_m, 2), np.repeat(weight, 2), ALL)
    for one, other in zip(once, again, strict=True):
        np.testing.assert_allclose(other, one, atol=1e-9)
