"""Limbs found again from the picture, whatever was predicted."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import (
    LEFT,
    NOTHING,
    adult_body,
    asset,
    joint_errors_m,
    joints_of,
    points,
    seen_body,
    standing,
    turned_about_y,
)

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.config import RegistrationConfig, Source
from anchorpose.body.expected_joints import Expected, expected_joints
from anchorpose.body.explanation import explain, limb_of_points
from anchorpose.body.limb_proposals import CHAINS, exchanged, limb_lengths, limb_poses, uncovered_paths, usual_poses
from anchorpose.body.limb_search import LOOK_AGAIN_M2, Search, needs_search, search_limbs, tried_pose
from anchorpose.body.pose import PARTS, POSE_SIZE, Pose
from anchorpose.body.registration import register
from anchorpose.body.skin_points import pose_points
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_INDEX
from anchorpose.simulate.render import TrueImage

BODY, CONFIG = adult_body(), RegistrationConfig()
TRUTH = standing(LeftArm=(70.0, 0.0, 0.0), RightArm=(-15.0, 0.0, 25.0), RightForeArm=(0.0, -30.0, 20.0))
"""The left arm raised sideways, the right one half forward."""

IN_TRUNK = {"LeftArm": (-70.0, 0.0, 0.0), "LeftForeArm": (0.0, -60.0, 0.0)}
ON_RIGHT_LEG = {"LeftUpLeg": (-14.0, 0.0, 0.0)}


def sure(pose: Pose) -> PoseBelief:
    """As certain as after some frames: a few degrees and a few centimetres."""
    belief = vague_belief(pose)
    return PoseBelief(pose, belief.covariance / 100.0, belief.information * 100.0)


def searched(pose: Pose, truth: Pose) -> Search:
    evidence = seen_body(truth, BODY)
    found = register(BODY, sure(pose), evidence, NOTHING, CONFIG)
    assert needs_search(explain(points(), pose_points(BODY, found.belief.pose), evidence))
    return search_limbs(BODY, found, sure(pose), evidence, CONFIG)


def spoilt(truth: Pose, **turns_deg: tuple[float, float, float]) -> Pose:
    """The pose with the named bones turned otherwise."""
    other, rotations = standing(**turns_deg), truth.rotations.copy()
    for name in turns_deg:
        bone = points().asset.bone(name)
        rotations[bone] = other.rotations[bone]
    return Pose(rotations, truth.root_m)


WRONG = {
    "an arm in the trunk": spoilt(TRUTH, **IN_TRUNK),
    "a leg on the other leg": spoilt(TRUTH, **ON_RIGHT_LEG),
    "arms exchanged": next(exchanged(BODY, TRUTH)),
    "the body turned round": turned_about_y(180.0, (0.0, 0.0, 0.0)).of_pose(TRUTH),
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG.keys())
def test_a_sure_and_wrong_pose_is_corrected_by_what_is_seen(wrong):
    assert joint_errors_m(BODY, wrong, TRUTH).max() > 0.2
    search = searched(wrong, TRUTH)
    assert search.taken
    assert joint_errors_m(BODY, search.registration.belief.pose, TRUTH).max() < 0.10


def behind_a_helper(view: View, picture: TrueImage) -> View:
    """The view with another person in front of the left leg, and in front of everything around this leg but the right
    leg.
    """
    left, right = (
        np.isin(picture.part, [asset().bone(f"{side}{bone}") + 1 for bone in ("UpLeg", "Leg", "Foot", "ToeBase")])
        for side in ("Left", "Right")
    )
    rows, columns = (np.flatnonzero(left.any(axis=axis)) for axis in (1, 0))
    front = np.zeros_like(left)
    front[rows[0] : rows[-1] + 10, columns[0] - 20 : columns[-1] + 20] = True
    front &= ~right
    labels = np.where(front, PixelLabel.OTHER_PERSON, view.labels).astype(np.uint8)
    return View(np.where(front, np.float32(1.8), view.depth_m), labels)


def test_a_hidden_leg_before_the_other_leg_goes_where_it_is_expected():
    """The leg lies on skin that the other leg shows as well, so no skin stays uncovered."""
    evidence, wrong = seen_body(TRUTH, BODY, change=behind_a_helper), spoilt(TRUTH, LeftUpLeg=(-20.0, 0.0, 50.0))
    ankle = JOINT_INDEX["AnkleLeft"]

    def after_m(*sources: Source) -> float:
        config = replace(CONFIG, sources=sources)
        found = register(BODY, sure(wrong), evidence, NOTHING, config)
        search = search_limbs(BODY, found, sure(wrong), evidence, config)
        return float(joint_errors_m(BODY, search.registration.belief.pose, TRUTH)[ankle])

    assert after_m(*(source for source in Source if source is not Source.HIDDEN)) > 0.3
    assert after_m(*Source) < 0.05


def test_a_hidden_limb_may_be_the_mirror_image_of_the_other_one():
    symmetrical = standing(
        **{f"{side}UpLeg": (turn, 0.0, 60.0) for side, turn in (("Left", -10.0), ("Right", 10.0))},
        LeftLeg=(0.0, 0.0, -80.0),
        RightLeg=(0.0, 0.0, -80.0),
    )
    wrong = spoilt(symmetrical, LeftUpLeg=(0.0, 0.0, 0.0), LeftLeg=(0.0, 0.0, 0.0), RightArm=(0.0, 20.0, 30.0))
    poses = list(usual_poses(BODY, wrong))
    assert len(poses) == 2 * len(CHAINS)
    legs = [JOINT_INDEX[name] for name in ("KneeLeft", "AnkleLeft", "FootLeft")]
    off_m = [float(joint_errors_m(BODY, pose, symmetrical)[legs].max()) for pose in poses]
    assert min(off_m) < 0.01


def test_a_right_pose_leaves_nothing_uncovered_and_no_limb_is_seen_past():
    explanation = explain(points(), pose_points(BODY, TRUTH), seen_body(TRUTH, BODY))
    assert explanation.uncovered_m2 < 0.001
    assert not needs_search(explanation)
    assert np.nanmax(explanation.seen_past) < 0.1


def test_a_limb_elsewhere_is_uncovered_skin_and_a_limb_before_the_wall():
    wrong = spoilt(TRUTH, LeftArm=(-15.0, 0.0, 60.0))
    explanation = explain(points(), pose_points(BODY, wrong), seen_body(TRUTH, BODY))
    assert explanation.uncovered_m2 > LOOK_AGAIN_M2
    limb = limb_of_points(points())
    left_arm = limb[points().part == points().asset.bone("LeftForeArm")][0]
    assert explanation.seen_past[left_arm] > 0.5
    assert (np.delete(explanation.seen_past, left_arm) < 0.15).all()
    assert len(explanation.seen_past) == PARTS


def test_skin_inside_the_trunk_covers_nothing():
    wrong = spoilt(TRUTH, **IN_TRUNK)
    explanation = explain(points(), pose_points(BODY, wrong), seen_body(TRUTH, BODY))
    hand = points().part == points().asset.bone("LeftHand")
    assert not explanation.covering[hand].any()
    right = explain(points(), pose_points(BODY, TRUTH), seen_body(TRUTH, BODY))
    assert right.covering[hand].any()


def test_the_path_of_an_uncovered_arm_leads_from_the_hand_to_the_shoulder():
    wrong, evidence = spoilt(TRUTH, **IN_TRUNK), seen_body(TRUTH, BODY)
    explanation = explain(points(), pose_points(BODY, wrong), evidence)
    path = uncovered_paths(evidence, explanation)[0]
    joints = joints_of(BODY, TRUTH)
    tip, root = joints[JOINT_INDEX["HandLeft"]], joints[JOINT_INDEX["ShoulderLeft"]]
    assert np.linalg.norm(path.places_m[0] - tip) < 0.15  # fingers reach beyond the joint
    assert np.linalg.norm(path.places_m[-1] - root) < 0.25
    assert (np.diff(path.along_m) > 0.0).all()
    assert path.along_m[0] == 0.0
    np.testing.assert_allclose(np.linalg.norm(path.inward, axis=1), 1.0, atol=1e-3)


def test_no_path_without_uncovered_skin():
    evidence = seen_body(TRUTH, BODY)
    explanation = explain(points(), pose_points(BODY, TRUTH), evidence)
    assert uncovered_paths(evidence, replace(explanation, node=explanation.node[:0])) == []


def test_every_limb_that_can_reach_is_proposed_along_the_path():
    """The left arm's pose is proposed from two starts; the right arm and the legs get theirs where they can reach."""
    wrong, evidence = spoilt(TRUTH, **IN_TRUNK), seen_body(TRUTH, BODY)
    path = uncovered_paths(evidence, explain(points(), pose_points(BODY, wrong), evidence))[0]
    at = np.array([joints_of(BODY, pose) for pose in limb_poses(BODY, wrong, path)])
    away = np.linalg.norm(at - joints_of(BODY, TRUTH)[JOINT_INDEX["HandLeft"]], axis=2)
    assert away[:, JOINT_INDEX["HandLeft"]].min() < 0.06
    assert (away[:, JOINT_INDEX["HandLeft"]] < 0.06).sum() == 2


def test_limbs_are_as_long_as_the_body_says():
    joints = BODY.mesh.rest_joints()
    for along_m, whole_m in limb_lengths(BODY):
        assert (np.diff(along_m) > 0.0).all()
        assert along_m[-1] < whole_m
    arm, _, leg, _ = limb_lengths(BODY)
    wrist, elbow = joints[JOINT_INDEX["WristLeft"]], joints[JOINT_INDEX["ElbowLeft"]]
    assert arm[0][2] - arm[0][1] == pytest.approx(float(np.linalg.norm(wrist - elbow)))
    assert leg[1] > arm[1]


def test_exchanged_limbs_keep_their_places():
    joints = joints_of(BODY, TRUTH)
    arms, legs, turned = (joints_of(BODY, pose) for pose in exchanged(BODY, TRUTH))
    assert np.linalg.norm(arms[JOINT_INDEX["HandRight"]] - joints[JOINT_INDEX["HandLeft"]]) < 0.35  # it hardly reaches
    assert np.linalg.norm(legs[JOINT_INDEX["AnkleRight"]] - joints[JOINT_INDEX["AnkleLeft"]]) < 0.08
    for name in ("HandLeft", "HandRight", "HipLeft", "ShoulderRight"):
        other = name.replace("Left", "X").replace("Right", "Left").replace("X", "Right")
        assert np.linalg.norm(turned[JOINT_INDEX[name]] - joints[JOINT_INDEX[other]]) < 0.08
    facing = [(set_[JOINT_INDEX["FootLeft"]] - set_[JOINT_INDEX["AnkleLeft"]])[0] for set_ in (joints, turned)]
    assert facing[0] > 0.05 > -0.05 > facing[1] or facing[1] < facing[0]


def test_a_limb_that_a_second_camera_alone_sees_is_found_there():
    wrong = spoilt(TRUTH, **IN_TRUNK)
    evidence = seen_body(TRUTH, BODY, (LEFT,))
    found = register(BODY, sure(wrong), evidence, NOTHING, CONFIG)
    search = search_limbs(BODY, found, sure(wrong), evidence, CONFIG)
    wrist = JOINT_INDEX["WristLeft"]
    assert joint_errors_m(BODY, search.registration.belief.pose, TRUTH)[wrist] < 0.08


def test_a_limb_elsewhere_costs_little_a_body_turned_round_much_and_an_unsure_one_less():
    """In images that tell nothing; log(1 + z^2) for each limb, so that no displacement is impossible."""
    seen = seen_body(TRUTH, BODY)
    dark = replace(seen, views=(None,) * len(seen.views))
    pose = standing()
    sure = PoseBelief(pose, 1e-4 * np.eye(POSE_SIZE), 1e4 * np.eye(POSE_SIZE))
    expected, unsure = expected_joints(BODY, sure), expected_joints(BODY, sure.later(pose, 4.0))
    arm = standing(LeftArm=(-60.0, 0.0, 0.0))
    *_, turned = exchanged(BODY, pose)

    def costs(where: Expected, moved: Pose) -> float:
        return tried_pose(where, moved, dark).moved

    assert costs(expected, pose) == pytest.approx(0.0, abs=1e-9)
    assert 3.0 < costs(expected, arm) < 8.0
    assert costs(expected, turned) > 2.0 * costs(expected, arm)
    assert costs(unsure, turned) < 0.7 * costs(expected, turned)
