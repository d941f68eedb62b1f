"""Other poses of arms and legs, tried when a limb is not where it was expected."""

from __future__ import annotations

import numpy as np
import pytest
from body_builder import adult_body, asset, joints_of, random_pose, turned_about_y

from anchorpose.body.registration import arm_candidates, leg_candidates
from anchorpose.joints import JOINT_INDEX

POSE = random_pose(2, 0.5)
FOREARM_ONLY = 6  # these come first
BODY = adult_body()
FIRST = {"Left": np.array([0.2, -1.0, -0.3]), "Right": np.array([0.2, -1.0, 0.3])}


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_a_candidate_keeps_all_bones_but_one_arm(side):
    arm = [asset().bone(f"{side}{bone}") for bone in ("Arm", "ForeArm", "Hand")]
    others = np.setdiff1d(np.arange(len(asset().bone_names)), arm)
    before = POSE.rotations.copy()
    candidates = list(arm_candidates(asset(), POSE, side))
    assert len(candidates) == FOREARM_ONLY + 12
    for candidate in candidates:
        np.testing.assert_array_equal(candidate.rotations[others], before[others])
        np.testing.assert_array_equal(candidate.root_m, POSE.root_m)
        turns = candidate.rotations[arm]
        np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (3, 1, 1)), atol=1e-12)
    np.testing.assert_array_equal(POSE.rotations, before)


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_candidates_differ_from_one_another_by_more_than_a_wrists_width(side):
    wrists = [joints_of(BODY, pose)[JOINT_INDEX[f"Wrist{side}"]] for pose in arm_candidates(asset(), POSE, side)]
    apart = np.linalg.norm(np.array(wrists)[:, None] - wrists, axis=2) + np.eye(len(wrists))
    assert apart.min() > 0.04


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_elbows_are_nearly_straight_or_bent_by_a_right_angle(side):
    for number, candidate in enumerate(list(arm_candidates(asset(), POSE, side))[FOREARM_ONLY:]):
        shoulder, elbow, wrist = (
            joints_of(BODY, candidate)[JOINT_INDEX[f"{j}{side}"]] for j in ("Shoulder", "Elbow", "Wrist")
        )
        cosine = (elbow - shoulder) @ (wrist - elbow) / np.linalg.norm(elbow - shoulder) / np.linalg.norm(wrist - elbow)
        # the asset's arm and this adult's differ by a degree or two at rest
        assert np.degrees(np.arccos(cosine)) == pytest.approx((15.0, 90.0)[number % 2], abs=4.0)


def test_legs_stand_or_sit_both_or_one():
    """Angles from straight, in degrees: the asset's legs stand a little apart, and this adult's differ a little."""
    found = []
    for candidate in leg_candidates(asset(), POSE):
        joints, legs = joints_of(BODY, candidate), []
        up = BODY.transforms(candidate)[asset().bone("Hips"), :3, 1]
        ahead = BODY.transforms(candidate)[asset().bone("Hips"), :3, 0]
        for side in ("Left", "Right"):
            hip, knee, ankle = (joints[JOINT_INDEX[f"{joint}{side}"]] for joint in ("Hip", "Knee", "Ankle"))
            thigh, shank = (part / np.linalg.norm(part) for part in (knee - hip, ankle - knee))
            legs.append(tuple(bool(value) for value in (thigh @ -up > 0.97, thigh @ ahead > 0.94, shank @ -up > 0.94)))
        found.append(tuple(legs))
    standing, sitting = (True, False, True), (False, True, True)
    before = joints_of(BODY, POSE)
    assert found[:2] == [(standing, standing), (sitting, sitting)]
    assert [legs[0] for legs in found[2:4]] == [standing, sitting]
    assert [legs[1] for legs in found[4:]] == [standing, sitting]
    kept = [joints_of(BODY, candidate) for candidate in leg_candidates(asset(), POSE)]
    right, left = JOINT_INDEX["AnkleRight"], JOINT_INDEX["AnkleLeft"]
    assert all((joints[right] == before[right]).all() for joints in kept[2:4])
    assert all((joints[left] == before[left]).all() for joints in kept[4:])


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_directions_are_in_the_axes_of_the_trunk(side):
    turned = turned_about_y(90.0, (1.0, 0.0, 0.0)).of_pose(random_pose(3, 0.0))
    for pose in (random_pose(3, 0.0), turned):
        first = list(arm_candidates(asset(), pose, side))[FOREARM_ONLY]
        transforms = BODY.transforms(first)
        parent = transforms[asset().bone(f"{side}Shoulder"), :3, :3]
        joints = joints_of(BODY, first)
        upper = parent.T @ (joints[JOINT_INDEX[f"Elbow{side}"]] - joints[JOINT_INDEX[f"Shoulder{side}"]])
        cosine = upper @ FIRST[side] / np.linalg.norm(upper) / np.linalg.norm(FIRST[side])
        assert cosine > np.cos(np.radians(5.0))


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_the_first_candidates_turn_a_bent_forearm_about_an_upper_arm_that_stays(side):
    shoulder, elbow, wrist = (JOINT_INDEX[f"{joint}{side}"] for joint in ("Shoulder", "Elbow", "Wrist"))
    before = joints_of(BODY, POSE)
    forearms = []
    for candidate in list(arm_candidates(asset(), POSE, side))[:FOREARM_ONLY]:
        joints = joints_of(BODY, candidate)
        np.testing.assert_allclose(joints[[shoulder, elbow]], before[[shoulder, elbow]], atol=0.01)
        forearms.append((joints[wrist] - joints[elbow]) / np.linalg.norm(joints[wrist] - joints[elbow]))
    upper = (before[elbow] - before[shoulder]) / np.linalg.norm(before[elbow] - before[shoulder])
    assert np.abs(np.degrees(np.arccos(np.array(forearms) @ upper)) - 90.0).max() < 5.0
    assert (np.array(forearms) @ np.array(forearms).T - np.eye(FOREARM_ONLY)).max() < 0.8  # all different ways
