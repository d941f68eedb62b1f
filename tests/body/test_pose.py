"""Pose changes, joint ranges and hinges."""

import numpy as np
import pytest
from body_builder import adult_body, asset, points, random_pose, standing
from scipy.spatial.transform import Rotation

from anchorpose.body.joint_ranges import (
    captured_turns,
    expected_turns,
    hinge_axes,
    joint_range,
    joint_range_at,
    limb_turns,
)
from anchorpose.body.kinematics import shape_body
from anchorpose.body.pose import DEGREE, MOVING_BONES, POSE_SIZE, Pose, descendants, moving_bones
from anchorpose.joints import JOINT_INDEX

MEAN = shape_body(asset(), np.zeros(0))
HINGES = ("LeftForeArm", "RightForeArm", "LeftLeg", "RightLeg")


def test_no_change_leaves_the_pose_and_a_change_back_restores_it():
    pose, moving = random_pose(1), points().moving
    still = pose.moved(np.zeros(POSE_SIZE), moving)
    np.testing.assert_allclose(still.rotations, pose.rotations, atol=1e-15)
    change = np.random.default_rng(2).normal(0.0, 0.3, POSE_SIZE)
    back = pose.moved(change, moving).moved(-change, moving)
    np.testing.assert_allclose(back.rotations, pose.rotations, atol=1e-12)
    np.testing.assert_allclose(back.root_m, pose.root_m, atol=1e-12)


def test_a_change_moves_only_the_moving_bones_and_not_the_pose_itself():
    pose = random_pose(1)
    before = pose.rotations.copy()
    moved = pose.moved(np.full(POSE_SIZE, 0.1), points().moving)
    fixed = np.setdiff1d(np.arange(len(before)), points().moving)
    np.testing.assert_array_equal(moved.rotations[fixed], before[fixed])
    np.testing.assert_array_equal(pose.rotations, before)
    assert (np.abs(moved.rotations[points().moving] - before[points().moving]).max(axis=(1, 2)) > 0.01).all()


@pytest.mark.parametrize(("turned_deg", "away"), [(0.0, False), (80.0, False), (100.0, True), (180.0, True)])
def test_a_body_faces_away_when_its_pelvis_turned_by_more_than_a_right_angle(turned_deg, away):
    one, other = standing(Hips=(0.0, 20.0, 0.0)), standing(Hips=(0.0, 20.0 + turned_deg, 0.0), LeftArm=(60.0, 0.0, 0.0))
    assert one.faces_away(other) == away
    assert other.faces_away(one) == away


def test_rotation_vectors_are_those_of_the_moving_bones():
    vectors = standing(LeftArm=(30.0, 0.0, 0.0), RightLeg=(0.0, 0.0, -50.0)).rotation_vectors(points().moving)
    found = {name: np.degrees(vectors[row]) for row, name in enumerate(MOVING_BONES) if vectors[row].any()}
    assert found.keys() == {"LeftArm", "RightLeg"}
    np.testing.assert_allclose(found["LeftArm"], [30.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(found["RightLeg"], [0.0, 0.0, -50.0], atol=1e-9)


def test_the_descendants_are_the_bones_that_a_turn_carries():
    carried = descendants(asset())
    for row, bone in enumerate(moving_bones(asset())):
        turned = standing(**{asset().bone_names[bone]: (20.0, 10.0, -15.0)})
        transforms = MEAN.bone_transforms(turned.rotations, MEAN.bone_heads[0])
        moved = np.abs(transforms[:, :3, :3] - np.eye(3)).max(axis=(1, 2)) > 1e-9
        np.testing.assert_array_equal(carried[row].astype(bool), moved)


def test_the_joint_range_is_finite_and_leaves_only_the_root_free():
    ranges = joint_range(asset())
    for values in (ranges.mean, ranges.information, ranges.hinge, ranges.hinge_limit):
        assert np.isfinite(values).all()
    assert not ranges.information[0].any()
    assert np.linalg.eigvalsh(without_root(ranges.information)).min() > 0.0


def without_root(information: np.ndarray) -> np.ndarray:
    return information[1:, :, 1:].reshape(3 * len(MOVING_BONES) - 3, -1)


def test_limbs_are_as_free_as_the_textbooks_say_and_as_people_who_were_captured():
    covariance = np.linalg.inv(without_root(joint_range(asset()).information))
    axes, _ = hinge_axes(asset(), "LeftLeg")
    knee = 3 * MOVING_BONES.index("LeftLeg") - 3
    bend = axes[0] @ covariance[knee : knee + 3, knee : knee + 3] @ axes[0]
    assert 40.0 * DEGREE <= np.sqrt(bend) < 60.0 * DEGREE
    turns = limb_turns()
    shown = captured_turns()[:, 3:]
    assert np.linalg.eigvalsh(shown @ covariance @ shown.T - turns.covariance).min() > 0.0


def test_hips_and_spine_share_the_bend_between_thigh_and_trunk_by_their_ranges():
    """Of people who sit, the most probable split: the spine takes a quarter; a third was measured (Schoberth 1962)."""
    ranges = joint_range(asset())
    mean, covariance = ranges.mean[1:].ravel(), np.linalg.inv(without_root(ranges.information))
    shown = captured_turns()[:, 3:]
    thighs = [row for row in shown if row.min() < 0.0]
    bent = np.full(len(thighs), 90.0 * DEGREE)
    spread = np.array(thighs) @ covariance @ np.array(thighs).T
    seated = mean + covariance @ np.array(thighs).T @ np.linalg.solve(spread, bent - np.array(thighs) @ mean)
    spine = -sum(seated[3 * MOVING_BONES.index(bone) - 1] for bone in ("LowerBack", "Spine", "Spine1"))
    hip = seated[3 * MOVING_BONES.index("LeftUpLeg") - 1]
    assert spine + hip == pytest.approx(90.0 * DEGREE)
    assert 0.2 < spine / (spine + hip) < 0.4


def test_a_hidden_leg_is_expected_to_sit_where_the_other_one_sits():
    """The most probable leg, given the other one bent as on a chair; ranges of each joint for itself know of none."""
    ranges = joint_range(asset())
    hidden = [3 * MOVING_BONES.index(bone) - 3 + k for bone in ("LeftUpLeg", "LeftLeg", "LeftFoot") for k in range(3)]
    mean, information = ranges.mean[1:].ravel(), without_root(ranges.information)
    seated = mean.copy()
    seated[3 * MOVING_BONES.index("RightUpLeg") - 1] = 60.0 * DEGREE
    for bone in ("LowerBack", "Spine", "Spine1"):
        seated[3 * MOVING_BONES.index(bone) - 1] = -8.0 * DEGREE
    seated[3 * MOVING_BONES.index("RightLeg") - 1] = -85.0 * DEGREE
    seen = np.setdiff1d(np.arange(len(mean)), hidden)
    pull = information[np.ix_(hidden, seen)] @ (seated - mean)[seen]
    expected = mean[hidden] - np.linalg.solve(information[np.ix_(hidden, hidden)], pull)
    assert expected[2] + 24.0 * DEGREE > 45.0 * DEGREE  # against the trunk
    assert expected[5] < -45.0 * DEGREE


def test_the_joint_range_is_the_same_on_both_sides():
    ranges, mirror = joint_range(asset()), np.diag([-1.0, -1.0, 1.0])  # of a rotation vector, through the X-Y plane
    for row, name in enumerate(MOVING_BONES):
        if not name.startswith("Left"):
            continue
        other = MOVING_BONES.index(name.replace("Left", "Right"))
        variance = [np.linalg.inv(ranges.information[r, :, r]) for r in (row, other)]
        np.testing.assert_allclose(mirror @ variance[0] @ mirror, variance[1], atol=1e-3)
        np.testing.assert_allclose(mirror @ ranges.mean[row], ranges.mean[other], atol=1e-3)
        assert ranges.hinge_limit[row] == pytest.approx(ranges.hinge_limit[other], abs=np.radians(0.1))


@pytest.mark.parametrize("name", HINGES)
def test_hinge_axes_are_an_orthonormal_right_handed_frame(name):
    axes, bend = hinge_axes(asset(), name)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert 0.0 <= bend < np.pi / 2.0


@pytest.mark.parametrize("name", ["ForeArm", "Leg"])
def test_hinge_axes_of_left_and_right_are_mirror_images(name):
    left, right = (hinge_axes(asset(), f"{side}{name}")[0][0] for side in ("Left", "Right"))
    np.testing.assert_allclose(left * [-1.0, -1.0, 1.0], right, atol=1e-3)  # an axial vector through the X-Y plane


def bent(name: str, angle_rad: float, joint: str) -> np.ndarray:
    """(3,) where a joint goes when a hinge alone turns."""
    rotations = np.tile(np.eye(3), (len(asset().bone_names), 1, 1))
    rotations[asset().bone(name)] = Rotation.from_rotvec(hinge_axes(asset(), name)[0][0] * angle_rad).as_matrix()
    return MEAN.joints(MEAN.bone_transforms(rotations, MEAN.bone_heads[0]))[JOINT_INDEX[joint]]


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_a_knee_bends_the_ankle_backwards_and_an_elbow_bends_the_wrist_forwards(side):
    rest = MEAN.rest_joints()
    ankle = bent(f"{side}Leg", np.radians(60.0), f"Ankle{side}") - rest[JOINT_INDEX[f"Ankle{side}"]]
    assert ankle[0] < -0.2
    assert abs(ankle[2]) < 0.06  # in the plane of the leg, give or take the shank's slant
    wrist = bent(f"{side}ForeArm", np.radians(40.0), f"Wrist{side}") - rest[JOINT_INDEX[f"Wrist{side}"]]
    assert wrist[0] > 0.05


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_an_elbow_at_its_limit_is_straight_and_bends_from_there(side):
    shoulder, elbow = (MEAN.rest_joints()[JOINT_INDEX[f"{name}{side}"]] for name in ("Shoulder", "Elbow"))
    limit = joint_range(asset()).hinge_limit[MOVING_BONES.index(f"{side}ForeArm")]

    def flexion(angle_rad: float) -> float:
        upper, lower = elbow - shoulder, bent(f"{side}ForeArm", angle_rad, f"Wrist{side}") - elbow
        cosine = upper @ lower / np.linalg.norm(upper) / np.linalg.norm(lower)
        return float(np.degrees(np.arccos(min(cosine, 1.0))))  # rounding may take it a digit beyond

    assert flexion(limit) < 1.0
    assert flexion(limit + np.radians(70.0)) == pytest.approx(70.0, abs=1.0)


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_a_knee_at_its_limit_is_one_standard_deviation_from_straight(side):
    hip, knee = (MEAN.rest_joints()[JOINT_INDEX[f"{name}{side}"]] for name in ("Hip", "Knee"))
    limit = joint_range(asset()).hinge_limit[MOVING_BONES.index(f"{side}Leg")]
    shank = bent(f"{side}Leg", limit, f"Ankle{side}") - knee
    thigh = knee - hip
    assert np.degrees(np.arctan2(*shank[[0, 1]]) - np.arctan2(*thigh[[0, 1]])) == pytest.approx(3.0, abs=1.5)


def arm_raised(side, degrees) -> Pose:
    """An arm turned outwards from hanging straight down, in the plane of the body."""
    rotations = np.tile(np.eye(3), (len(asset().bone_names), 1, 1))
    along = asset().bone_heads[asset().bone(f"{side}ForeArm")] - asset().bone_heads[asset().bone(f"{side}Arm")]
    outwards = -1.0 if side == "Left" else 1.0
    wanted = np.array([0.0, -np.cos(degrees * DEGREE), outwards * np.sin(degrees * DEGREE)])
    turned, _ = Rotation.align_vectors(wanted[None], along[None] / np.linalg.norm(along))
    rotations[asset().bone(f"{side}Arm")] = turned.as_matrix()
    return Pose(rotations, np.zeros(3))


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_a_raised_arm_takes_its_shoulder_up_and_the_other_stays(side):
    girdle = MOVING_BONES.index(f"{side}Shoulder")
    rest = joint_range(asset()).mean
    hanging, up = (joint_range_at(asset(), arm_raised(side, degrees)).mean for degrees in (20.0, 180.0))
    assert hanging[girdle] == pytest.approx(rest[girdle])
    assert np.linalg.norm(up[girdle]) == pytest.approx(30.0 * DEGREE)
    pose = arm_raised(side, 180.0)
    pose.rotations[asset().bone(f"{side}Shoulder")] = Rotation.from_rotvec(up[girdle]).as_matrix()
    shoulder = JOINT_INDEX[f"Shoulder{side}"]
    body = adult_body()
    assert body.joints(pose)[shoulder, 1] > body.joints(arm_raised(side, 180.0))[shoulder, 1] + 0.05
    others = np.delete(np.arange(len(MOVING_BONES)), [girdle, MOVING_BONES.index(_other(side))])
    assert up[others] == pytest.approx(rest[others])


def _other(side) -> str:
    """The other side's girdle: its arm is as in the rest pose, which is raised a little."""
    return "RightShoulder" if side == "Left" else "LeftShoulder"


def test_what_readings_show_is_held_no_tighter_than_what_is_hidden_and_at_most_twice_as_loosely():
    """Flexions keep their range; turns about a limb's own axis, abduction and feet get up to 35 degrees."""
    seen = np.linalg.inv(without_root(joint_range(asset(), ()).information))
    textbook = np.linalg.inv(without_root(joint_range(asset(), tuple(range(1, len(MOVING_BONES)))).information))
    row = MOVING_BONES.index("LeftUpLeg") - 1
    sigma = np.degrees(np.sqrt(np.diag(seen)))[3 * row : 3 * row + 3]
    np.testing.assert_allclose(sigma, [32.0, 32.0, 35.0], atol=1e-6)
    assert np.degrees(np.sqrt(np.diag(textbook)))[3 * row] < 32.0


def test_the_expected_turns_are_the_conditional_mean_of_the_joint_ranges():
    """By the covariance instead of its inverse; the other leg's bent knee bends the expected knee."""
    ranges, size = joint_range(asset()), 3 * len(MOVING_BONES)
    covariance = np.linalg.inv(ranges.information.reshape(size, size)[3:, 3:])
    rows, pose = [MOVING_BONES.index(bone) for bone in ("LeftUpLeg", "LeftLeg")], random_pose(4)
    wanted = np.array([3 * row + axis - 3 for row in rows for axis in range(3)])
    others = np.setdiff1d(np.arange(size - 3), wanted)
    away = (pose.rotation_vectors(points().moving) - ranges.mean).ravel()[3:][others]
    gain = np.linalg.solve(covariance[np.ix_(others, others)], covariance[np.ix_(others, wanted)]).T
    expected = ranges.mean[rows] + (gain @ away).reshape(-1, 3)
    np.testing.assert_allclose(expected_turns(asset(), pose, rows), expected, atol=1e-9)
    straight, bent = standing(), standing(RightUpLeg=(0.0, 0.0, 60.0), RightLeg=(0.0, 0.0, -80.0))
    knees = [expected_turns(asset(), pose, rows)[1, 2] for pose in (straight, bent)]
    assert knees[1] < knees[0] - 10.0 * DEGREE
