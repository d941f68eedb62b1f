"""Limbs do not enter the trunk."""

import numpy as np
import pytest
from body_builder import adult_body, asset, points, standing, turned_about_y
from scipy.spatial import cKDTree

from anchorpose.body.config import RegistrationConfig
from anchorpose.body.evidence import separation_rows, shanks, trunk_and_arms
from anchorpose.body.fit import hidden_bones, limited, pose_equations, prior_equations, solve_damped
from anchorpose.body.pose import POSE_SIZE, Pose
from anchorpose.body.skin_points import pose_points

BODY, ROWS = adult_body(), RegistrationConfig().rows_per_observation
ASIDE = standing(LeftArm=(-20.0, 0.0, 0.0), RightArm=(20.0, 0.0, 0.0))
INSIDE = standing(RightArm=(55.0, 0.0, 0.0), RightForeArm=(30.0, 0.0, 0.0))  # the right forearm swung through the hip


def rows_of(pose: Pose):
    return separation_rows(BODY, pose_points(BODY, pose))


def bones_of(index: np.ndarray) -> set[str]:
    return {asset().bone_names[part] for part in points().part[index]}


def test_arms_beside_the_body_are_left_alone():
    assert len(rows_of(ASIDE)) == 0


def test_trunk_and_arms_are_apart_and_both_sides_are_there():
    trunk, arms = trunk_and_arms(points())
    assert not set(trunk) & set(arms)
    assert {"Hips", "Spine1"} <= bones_of(trunk)
    assert {"LeftForeArm", "RightForeArm", "LeftHand", "RightHand"} <= bones_of(arms)
    assert not bones_of(arms) & {"LeftArm", "RightArm", "LeftLeg", "Head"}


def test_a_forearm_inside_the_trunk_is_pushed_out_of_it():
    rows, posed = rows_of(INSIDE), pose_points(BODY, INSIDE)
    assert len(rows) > 5
    assert all(name.startswith("R") for name in bones_of(rows.point))
    assert (rows.residuals(posed) < -0.009).all()  # behind the skin it is held against
    np.testing.assert_allclose(np.linalg.norm(rows.direction, axis=1), 1.0)


def test_following_the_rows_takes_the_forearm_out():
    pose, near = INSIDE, np.eye(POSE_SIZE)
    depth = [-rows_of(pose).residuals(pose_points(BODY, pose)).sum()]
    for _ in range(6):
        posed = pose_points(BODY, pose)
        rows = rows_of(pose)
        prior = prior_equations(points(), pose, (INSIDE, near), hidden_bones(points(), rows, ROWS))
        equations = pose_equations(BODY, pose, posed, rows, prior, ROWS)
        pose = pose.moved(limited(solve_damped(equations)), points().moving)
        depth.append(-rows_of(pose).residuals(pose_points(BODY, pose)).sum())
    assert depth[-1] < 0.3 * depth[0], depth


@pytest.mark.parametrize("degrees", [60.0, 200.0])
def test_the_rows_turn_with_the_body(degrees):
    motion = turned_about_y(degrees, (1.0, 0.2, -0.5))
    here, there = rows_of(INSIDE), rows_of(motion.of_pose(INSIDE))
    np.testing.assert_array_equal(there.point, here.point)
    np.testing.assert_allclose(there.direction, here.direction @ motion.T[:3, :3].T, atol=1e-9)


def test_the_nearest_skin_of_the_trunk_is_that_of_a_search_tree():
    trunk, arms = trunk_and_arms(points())
    posed = pose_points(BODY, INSIDE)
    distance, nearest = cKDTree(posed.points_m[trunk]).query(posed.points_m[arms], distance_upper_bound=0.15)
    skin = trunk[nearest[distance < 0.15]]
    depth = ((posed.points_m[skin] - posed.points_m[arms[distance < 0.15]]) * posed.normals[skin]).sum(axis=1)
    np.testing.assert_array_equal(rows_of(INSIDE).point, arms[distance < 0.15][depth > 0.01])
    np.testing.assert_array_equal(rows_of(INSIDE).target_m, posed.points_m[skin[depth > 0.01]])


def test_a_leg_that_explains_the_same_surface_as_the_other_one_is_pushed_out_of_it():
    """Both legs in one place have the same skin; side by side, or one before the other, they are left alone."""
    left, right = shanks(points())
    together = standing(LeftUpLeg=(-13.0, 0.0, 0.0), RightUpLeg=(13.0, 0.0, 0.0))
    inside = rows_of(together)
    assert len(inside) > 20
    assert set(inside.point) <= set(left)
    apart = (
        ASIDE,
        standing(LeftUpLeg=(0.0, 0.0, 40.0)),
        standing(LeftUpLeg=(0.0, 0.0, 60.0), LeftLeg=(0.0, 0.0, -60.0)),
    )
    for pose in apart:
        assert not set(rows_of(pose).point) & set(left)
    assert not set(left) & set(right)
    assert {"LeftLeg", "LeftFoot"} <= bones_of(left)
