"""What each joint's state is when something hides it."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from body_builder import (
    FRONT,
    LEFT,
    adult_body,
    asset,
    before_wall,
    camera_at,
    photograph,
    points,
    skin_in,
    standing,
    stepped,
    turned_about_y,
)

from anchorpose.body import visibility
from anchorpose.body.config import VisibilityConfig
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import pose_points
from anchorpose.body.visibility import SkinReason, joint_states, pixels_of, projection_of, skin_around_joints
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_NAMES, JointState
from anchorpose.lens import Intrinsics
from anchorpose.simulate.render import TrueImage

BODY = adult_body()
POSE = standing(LeftArm=(-20.0, 0.0, 0.0), RightArm=(20.0, 0.0, 0.0))
CONFIG = VisibilityConfig()
ALL = np.ones(len(points().vertex), dtype=bool)  # every skin point covers what is seen at its place
Change = Callable[[View, TrueImage], View]
LEG = ("KneeLeft", "AnkleLeft", "FootLeft")


def states(
    pose: Pose = POSE, cameras: Sequence[Camera] = (FRONT,), change: Change | None = None, drawn: Pose | None = None
) -> dict[str, JointState]:
    """The states of a body in a pose, in pictures of it (or of another pose), changed."""
    views = []
    for camera in cameras:
        picture = photograph(skin_in(drawn or pose, BODY), camera)
        view = before_wall(picture, camera)
        views.append(view if change is None else change(view, picture))
    found = joint_states(points(), pose_points(BODY, pose), ALL, views, cameras, CONFIG)
    return dict(zip(JOINT_NAMES, found, strict=True))


def left_leg_is(label: int, nearer_m: float | None) -> Change:
    """The left leg's pixels show something nearer by so much, or (None) nothing."""
    bones = [asset().bone(name) + 1 for name in ("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase")]

    def change(view: View, picture: TrueImage) -> View:
        leg = np.isin(picture.part, bones)
        depth = np.zeros_like(view.depth_m) if nearer_m is None else view.depth_m - np.float32(nearer_m)
        return View(np.where(leg, depth, view.depth_m), np.where(leg, label, view.labels).astype(np.uint8))

    return change


def test_what_is_seen_is_observed():
    found = states()
    assert {name for name, state in found.items() if state != JointState.OBSERVED} <= {"SpineMid"}


def test_a_camera_in_front_observes_the_middle_of_the_spine():
    assert states()["SpineMid"] == JointState.OBSERVED


@pytest.mark.parametrize(
    ("label", "nearer_m", "state"),
    [
        (PixelLabel.EQUIPMENT, 0.15, JointState.HIDDEN_BY_EQUIPMENT),
        (PixelLabel.EQUIPMENT, 0.0, JointState.HIDDEN_BY_EQUIPMENT),
        (PixelLabel.OTHER_PERSON, 0.3, JointState.HIDDEN_BY_PERSON),
        (PixelLabel.OTHER_PERSON + 3, 0.3, JointState.HIDDEN_BY_PERSON),
        (PixelLabel.NO_READING, None, JointState.HIDDEN),
        (PixelLabel.CLUTTER, 0.1, JointState.HIDDEN),
    ],
)
def test_a_leg_behind_something_is_hidden_by_it_and_the_rest_stays_observed(label, nearer_m, state):
    found = states(change=left_leg_is(label, nearer_m))
    assert {found[name] for name in LEG} == {state}
    others = {name for name in JOINT_NAMES if name not in (*LEG, "HipLeft", "SpineBase", "SpineMid")}
    assert {found[name] for name in others} == {JointState.OBSERVED}


def test_a_body_before_equipment_and_people_is_not_hidden_by_them():
    def behind(label: int) -> Change:
        return lambda view, picture: View(
            view.depth_m, np.where(view.patient, PixelLabel.PATIENT, label).astype(np.uint8)
        )

    for label in (PixelLabel.EQUIPMENT, PixelLabel.OTHER_PERSON):
        assert states(change=behind(label)) == states()


def test_feet_below_the_picture_are_out_of_view():
    high = camera_at((1.6, 1.5, 0.0), (0.0, 1.6, 0.0))
    found = states(cameras=(high,))
    for name in ("AnkleLeft", "AnkleRight", "FootLeft", "FootRight"):
        assert found[name] == JointState.OUT_OF_VIEW
    for name in ("Head", "Neck", "ShoulderLeft", "ShoulderRight"):
        assert found[name] == JointState.OBSERVED


@pytest.mark.parametrize("cut", range(6))
def test_no_joint_outside_the_picture_is_observed(cut):
    """The lower border anywhere from the toes to the shank: skin above it may be seen, the joint is not."""
    place = transform_points(invert_rigid(FRONT.require_pose()), BODY.joints(POSE))
    row = FRONT.intrinsics.fy * place[:, 1] / place[:, 2] + FRONT.intrinsics.cy
    foot, knee = (row[JOINT_NAMES.index(name)] for name in ("FootLeft", "KneeLeft"))
    border = int(foot + (knee - foot) * cut / 10)
    found = states(cameras=(replace(FRONT, height=border),))
    outside = [name for name, at in zip(JOINT_NAMES, row, strict=True) if at > border + 4]
    assert outside or cut == 0
    assert {found[name] for name in outside} <= {JointState.OUT_OF_VIEW, JointState.HIDDEN_BY_SELF}
    assert found["KneeLeft"] == JointState.OBSERVED


def test_the_far_side_of_the_body_is_hidden_by_the_patient_himself():
    side = camera_at((0.0, 1.1, -2.4), (0.0, 0.9, 0.0))  # from the patient's left
    found = states(cameras=(side,))
    for name in ("ElbowRight", "ShoulderRight", "HipRight"):
        assert found[name] == JointState.HIDDEN_BY_SELF
    for name in ("ElbowLeft", "WristLeft", "ShoulderLeft", "KneeLeft", "Head"):
        assert found[name] == JointState.OBSERVED


def test_one_camera_that_sees_a_joint_is_enough():
    side = camera_at((0.0, 1.1, -2.4), (0.0, 0.9, 0.0), "side")
    other = camera_at((0.0, 1.1, 2.4), (0.0, 0.9, 0.0), "other")
    both = states(cameras=(side, other))
    assert {both[name] for name in ("ElbowRight", "ElbowLeft", "HipRight", "HipLeft")} == {JointState.OBSERVED}


def elsewhere(label: int) -> Change:
    """A change of the picture: what is behind the patient has this label."""
    return lambda view, picture: View(view.depth_m, np.where(view.patient, PixelLabel.PATIENT, label).astype(np.uint8))


ARM_IN_THE_AIR = standing(LeftArm=(80.0, 0.0, 0.0))


@pytest.mark.parametrize("label", [PixelLabel.BACKGROUND, PixelLabel.CLUTTER])
def test_an_arm_that_a_camera_sees_past_is_lost_whatever_is_behind_it(label):
    found = states(pose=ARM_IN_THE_AIR, drawn=POSE, change=elsewhere(label))
    assert {found[name] for name in ("ElbowLeft", "WristLeft", "HandLeft")} == {JointState.LOST}


def test_a_camera_whose_view_is_blocked_does_not_save_an_arm_that_another_camera_sees_past():
    seen = before_wall(photograph(skin_in(POSE, BODY), FRONT), FRONT)
    picture = before_wall(photograph(skin_in(POSE, BODY), LEFT), LEFT)
    wall = View(np.full_like(picture.depth_m, 0.5), np.full_like(picture.labels, PixelLabel.OTHER_PERSON))
    posed = pose_points(BODY, ARM_IN_THE_AIR)
    for views, cameras in (((seen,), (FRONT,)), ((seen, wall), (FRONT, LEFT))):
        found = dict(zip(JOINT_NAMES, joint_states(points(), posed, ALL, views, cameras, CONFIG), strict=True))
        assert {found[name] for name in ("ElbowLeft", "WristLeft", "HandLeft")} == {JointState.LOST}


def test_a_camera_without_a_picture_says_nothing():
    picture = photograph(skin_in(POSE, BODY), FRONT)
    posed, view = pose_points(BODY, POSE), before_wall(picture, FRONT)
    alone = joint_states(points(), posed, ALL, (view,), (FRONT,), CONFIG)
    assert joint_states(points(), posed, ALL, (None, view), (LEFT, FRONT), CONFIG) == alone


def test_no_picture_at_all_hides_everything_for_no_known_reason():
    found = joint_states(points(), pose_points(BODY, POSE), ALL, (None,), (FRONT,), CONFIG)
    assert set(found) == {JointState.HIDDEN}


def test_skin_that_should_be_seen_but_is_not_is_not_called_observed():
    away = stepped(POSE, 0.3, 0.0, 0.0)
    found = states(pose=away, drawn=POSE)
    assert JointState.OBSERVED not in found.values()


def test_states_move_with_camera_and_body():
    motion = turned_about_y(120.0, (1.0, 0.0, 2.0))
    change = left_leg_is(PixelLabel.EQUIPMENT, 0.1)
    moved = states(motion.of_pose(POSE), (motion.of_camera(FRONT),), change)
    assert moved == states(change=change)


def test_every_joint_has_skin_around_it_that_moves_with_it():
    around = skin_around_joints(points())
    joints = adult_body().mesh.rest_joints()
    for name, joint, skin in zip(JOINT_NAMES, joints, around, strict=True):
        assert len(skin) >= 5, name
        assert np.linalg.norm(BODY.rest_m[skin] - joint, axis=1).max() < 0.3, name
    left, right = (set(around[JOINT_NAMES.index(f"Knee{side}")].tolist()) for side in ("Left", "Right"))
    assert not left & right


@pytest.mark.parametrize("value", [0.0, -0.1, float("nan")])
def test_a_configuration_that_cannot_work_is_refused(value):
    with pytest.raises(ValueError, match="reach_m"):
        VisibilityConfig(reach_m=value)


def test_skin_falls_on_the_pixels_that_the_camera_says():
    lens = Intrinsics(fx=365.0, fy=360.0, cx=250.0, cy=205.0, distortion=(0.09, -0.27, 0.002, -0.001, 0.1))
    camera = replace(FRONT, intrinsics=lens)
    places = np.random.default_rng(3).normal(0.0, 2.5, (4000, 3))
    in_camera = transform_points(invert_rigid(camera.require_pose()), places)
    column, row, inside = camera.pixel_of(in_camera)
    found = pixels_of(places, projection_of(camera), camera.height, camera.width)
    np.testing.assert_array_equal(found[0], np.where(inside, column, -1))
    np.testing.assert_array_equal(found[1], np.where(inside, row, -1))
    np.testing.assert_allclose(found[2], in_camera[:, 2], atol=1e-12)


def test_what_pixels_say_of_skin_is_what_the_rules_written_out_say():
    rng = np.random.default_rng(5)
    labels = rng.integers(0, 8, (40, 50)).astype(np.uint8)
    depth = rng.uniform(1.9, 2.1, labels.shape).astype(np.float32)
    row, column = rng.integers(0, 40, 3000), rng.integers(0, 50, 3000)
    far, reach = np.full(3000, 2.0), 0.04
    before, near = depth[row, column] < far - reach, np.abs(depth[row, column] - far) <= reach
    label = labels[row, column]
    wanted = np.full(3000, SkinReason.PAST)
    wanted[(label == PixelLabel.PATIENT) & before] = SkinReason.SELF
    wanted[(label == PixelLabel.EQUIPMENT) & (before | near)] = SkinReason.EQUIPMENT
    wanted[(label >= PixelLabel.OTHER_PERSON) & (before | near)] = SkinReason.PERSON
    wanted[((label == PixelLabel.BACKGROUND) | (label == PixelLabel.CLUTTER)) & (before | near)] = SkinReason.HOLE
    wanted[label == PixelLabel.NO_READING] = SkinReason.HOLE
    wanted[(label == PixelLabel.PATIENT) & near] = SkinReason.SEEN
    column[::9] = row[::9] = -1
    wanted[::9] = SkinReason.OUTSIDE
    np.testing.assert_array_equal(visibility._read(column, row, far, labels, depth, reach), wanted)


def test_skin_faces_an_eye_up_to_the_grazing_angle():
    angle = np.radians([0.0, 60.0, 75.0, 76.0, 120.0])  # arccos 0.25 is 75.5 degrees
    normals = np.stack([np.sin(angle), np.zeros(5), np.cos(angle)], axis=1)
    facing = visibility._turned_to(np.zeros((5, 3)), normals, np.array([0.0, 0.0, 3.0]), 0.25)
    assert facing.tolist() == [True, True, True, False, False]
