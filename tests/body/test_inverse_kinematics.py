"""From joint positions back to a pose."""

import numpy as np
import pytest
from body_builder import adult_body, joint_errors_m, joints_of, points, random_pose, shaken

from anchorpose.body.inverse_kinematics import pose_from_joints
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES

BODY = adult_body()


@pytest.mark.parametrize("seed", range(4))
def test_the_joints_of_a_nearby_pose_are_reached(seed):
    truth = random_pose(seed)
    start = shaken(truth, seed + 10, turn_deg=4.0, shift_m=0.03)
    found = pose_from_joints(BODY, start, joints_of(BODY, truth))
    assert joint_errors_m(BODY, start, truth).mean() > 0.04
    # the joint range and the start pull by a few millimetres against joints that are believed to 10 mm
    assert joint_errors_m(BODY, found, truth).mean() < 0.004
    assert joint_errors_m(BODY, found, truth).max() < 0.015


def test_joints_that_are_met_already_leave_the_pose_nearly_alone():
    pose = random_pose(5)
    found = pose_from_joints(BODY, pose, joints_of(BODY, pose))
    assert joint_errors_m(BODY, found, pose).max() < 0.006


def test_rows_of_nan_say_nothing():
    truth = random_pose(6)
    start = shaken(truth, 16, turn_deg=4.0, shift_m=0.02)
    joints = joints_of(BODY, truth)
    arm = [JOINT_INDEX[name] for name in ("ElbowLeft", "WristLeft", "HandLeft")]
    joints[arm] = np.nan
    found = pose_from_joints(BODY, start, joints)
    assert np.isfinite(found.rotations).all()
    known = [index for index in range(len(JOINT_NAMES)) if index not in arm]
    assert joint_errors_m(BODY, found, truth)[known].mean() < 0.004
    elbow = points().moving.tolist().index(points().asset.bone("LeftForeArm"))
    kept, before = (pose.rotation_vectors(points().moving)[elbow] for pose in (found, start))
    assert np.degrees(np.linalg.norm(kept - before)) < 10.0  # only how joints bend pulls


def test_without_any_joint_the_pose_stays_near_the_start():
    start = random_pose(7)
    found = pose_from_joints(BODY, start, np.full((21, 3), np.nan))
    np.testing.assert_allclose(found.root_m, start.root_m, atol=1e-9)
    turned = np.linalg.norm(found.rotation_vectors(points().moving) - start.rotation_vectors(points().moving), axis=1)
    assert np.degrees(turned.max()) < 30.0


def test_the_same_joints_give_the_same_bits():
    truth = random_pose(8)
    start = shaken(truth, 18, turn_deg=4.0, shift_m=0.02)
    first, again = (pose_from_joints(BODY, start, joints_of(BODY, truth)) for _ in range(2))
    np.testing.assert_array_equal(first.rotations, again.rotations)
