"""Poses spoilt on purpose are wrong as they should be, trials are judged by the rules, and shares have intervals."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from body_builder import adult_body, standing

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from intervals import paired_difference, wilson
from kidnapped_limbs import draw_spoil, judged_joints, spread
from kidnapping import Judge, Limits
from spoilt_poses import Kind, Spoil, depth_in_trunk_m, displacement_m, middle_of_trunk, spoilt

from anchorpose.body.pose import LIMB_OF_JOINTS
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.results.evaluate_confidence import LIMBS_JUDGED

BODY = adult_body()
POSTURES = {
    "arms apart": standing(),
    "arms down": standing(LeftArm=(-60.0, 0.0, 0.0), RightArm=(60.0, 0.0, 0.0)),
    "arms up": standing(LeftArm=(80.0, 0.0, 0.0), RightArm=(-80.0, 0.0, 0.0)),
    "bent": standing(LowerBack=(0.0, 0.0, -30.0), LeftUpLeg=(0.0, 0.0, 40.0), LeftLeg=(0.0, 0.0, -50.0)),
}


def joints(pose) -> np.ndarray:
    return BODY.joints(pose)


def at(pose, name: str) -> np.ndarray:
    return joints(pose)[JOINT_INDEX[name]]


@pytest.mark.parametrize("posture", POSTURES)
@pytest.mark.parametrize("side", ["Left", "Right"])
@pytest.mark.parametrize("height", [0.2, 0.5, 0.75])
def test_an_arm_put_into_the_trunk_has_its_hand_deep_inside(posture, side, height):
    pose = POSTURES[posture]
    after = spoilt(BODY, pose, Spoil(Kind.ARM_IN_TRUNK, side, height))
    hand = at(after, f"Hand{side}")
    assert np.linalg.norm(hand - middle_of_trunk(BODY, pose, height)) < 0.02
    assert depth_in_trunk_m(BODY, after, hand) > 0.06
    assert displacement_m(BODY, pose, after)[JOINT_INDEX[f"Hand{side}"]] > 0.15


def test_the_depth_in_the_trunk_is_negative_outside():
    pose = POSTURES["arms apart"]
    assert depth_in_trunk_m(BODY, pose, at(pose, "HandLeft")) < -0.1


@pytest.mark.parametrize("posture", POSTURES)
def test_exchanged_arms_cross_the_body_and_each_hand_is_nearer_to_the_other_ones_place(posture):
    pose = POSTURES[posture]
    after = spoilt(BODY, pose, Spoil(Kind.ARMS_EXCHANGED))
    for side, other in (("Left", "Right"), ("Right", "Left")):
        hand = at(after, f"Hand{side}")
        away_m = np.linalg.norm(hand - at(pose, f"Hand{other}"))
        assert away_m < 0.3 * np.linalg.norm(at(pose, f"Hand{side}") - at(pose, f"Hand{other}"))
        assert hand[2] * at(pose, f"Hand{side}")[2] < 0.0  # on the other side of the body, which faces X


@pytest.mark.parametrize("side", ["Left", "Right"])
@pytest.mark.parametrize("posture", POSTURES)
def test_one_leg_lies_on_the_other_one(posture, side):
    pose, other = POSTURES[posture], {"Left": "Right", "Right": "Left"}[side]
    after = spoilt(BODY, pose, Spoil(Kind.LEG_ON_LEG, side))
    for joint, within_m in (("Knee", 0.12), ("Ankle", 0.08), ("Foot", 0.08)):  # hips are 18 cm apart
        assert np.linalg.norm(at(after, f"{joint}{side}") - at(pose, f"{joint}{other}")) < within_m


@pytest.mark.parametrize("posture", POSTURES)
def test_a_body_turned_round_has_every_joint_on_the_far_side_of_the_vertical_through_the_pelvis(posture):
    pose = POSTURES[posture]
    before, after = joints(pose), joints(spoilt(BODY, pose, Spoil(Kind.TURNED_ROUND)))
    axis = pose.root_m * (1.0, 0.0, 1.0)
    np.testing.assert_allclose(after - axis, (before - axis) * (-1.0, 1.0, -1.0), atol=1e-9)


@pytest.mark.parametrize("kind", list(Kind))
def test_only_the_limbs_concerned_move_and_bones_keep_their_length(kind):
    pose, spoil = POSTURES["arms apart"], Spoil(kind, "Right")
    after = spoilt(BODY, pose, spoil)
    moved_m = displacement_m(BODY, pose, after)
    names = {"arm_left": 1, "leg_left": 2, "arm_right": 3, "leg_right": 4, "trunk_and_head": 0}
    limbs = [names[limb] for limb in spoil.limbs]
    assert moved_m[~np.isin(LIMB_OF_JOINTS, limbs)].max(initial=0.0) < 1e-9
    for one, other in (("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Knee", "Ankle")):
        lengths = [np.linalg.norm(at(p, f"{one}Right") - at(p, f"{other}Right")) for p in (pose, after)]
        assert lengths[0] == pytest.approx(lengths[1], abs=1e-9)
    assert moved_m[np.concatenate([LIMBS_JUDGED[limb] for limb in spoil.limbs])].max() > 0.15


def _judge(errors_m, usual_m=0.0, joints=(JOINT_INDEX["HandLeft"],), period_s=0.1) -> Judge:
    """A judge who has seen one error of the hand per frame, one frame every ``period_s`` after the spoilt one."""
    place = np.zeros((JOINT_COUNT, 3))

    def off(error_m: float) -> np.ndarray:
        joints_m = place.copy()
        joints_m[JOINT_INDEX["HandLeft"], 1] = error_m
        return joints_m

    judge = Judge(5.0, np.array(joints), lambda frame: place, lambda frame: off(usual_m), Limits())
    for frame, error_m in enumerate(errors_m, 1):
        if not judge.done:
            judge.take(frame, 5.0 + frame * period_s, off(error_m))
    return judge


@pytest.mark.parametrize(
    ("errors_m", "recovered_s"),
    [
        ([0.3] * 4 + [0.09] * 6, 0.5),  # right from half a second on
        ([0.3] * 5 + [0.0] * 5, None),  # a frame too late
        ([0.0] * 10, 0.1),
        ([0.0] * 3 + [0.3] + [0.0] * 6, 0.5),  # right, wrong, and right for good
        ([0.0] * 8 + [0.3, 0.0], None),  # does not stay so
        ([0.3] * 4 + [0.101] * 6, None),
        ([0.3] * 4 + [0.02] * 6 + [0.4] * 5, 0.5),  # what comes after the second is not judged
    ],
)
def test_a_limb_is_right_again_by_half_a_second_and_stays_so_until_a_second(errors_m, recovered_s):
    outcome = _judge(errors_m).outcome()
    assert outcome.right == (recovered_s is not None)
    assert outcome.recovered_s == (None if recovered_s is None else pytest.approx(recovered_s))


def test_a_limb_may_be_as_wrong_as_without_the_spoiling_and_fifty_millimetres_more():
    assert _judge([0.24] * 10, usual_m=0.2).outcome().right
    assert not _judge([0.26] * 10, usual_m=0.2).outcome().right


def test_joints_of_other_limbs_do_not_count():
    assert _judge([0.5] * 10, joints=(JOINT_INDEX["HandRight"],)).outcome().right


def test_a_judge_is_done_as_soon_as_the_outcome_is_certain():
    failed = _judge([0.3] * 6)
    assert failed.done
    assert not failed.outcome().right
    assert not _judge([0.3] * 4 + [0.0] * 6).done


VISIBLE = dict.fromkeys(LIMBS_JUDGED, True)


def test_the_limbs_concerned_must_be_in_plain_view():
    arm = Spoil(Kind.ARM_IN_TRUNK, "Right")
    assert judged_joints(arm, VISIBLE).tolist() == LIMBS_JUDGED["arm_right"].tolist()
    assert judged_joints(arm, VISIBLE | {"arm_left": False}) is not None
    assert judged_joints(arm, VISIBLE | {"arm_right": False}) is None
    assert judged_joints(Spoil(Kind.ARMS_EXCHANGED), VISIBLE | {"arm_right": False}) is None


def test_of_a_body_turned_round_the_limbs_in_view_count():
    turned = Spoil(Kind.TURNED_ROUND)
    assert len(judged_joints(turned, VISIBLE)) == JOINT_COUNT
    assert len(judged_joints(turned, VISIBLE | {"arm_left": False, "leg_left": False})) == JOINT_COUNT - 6
    assert judged_joints(turned, VISIBLE | {"trunk_and_head": False}) is None
    assert judged_joints(turned, dict.fromkeys(LIMBS_JUDGED, False) | {"trunk_and_head": True}) is None


def test_a_spoil_is_drawn_the_same_again_and_takes_both_sides():
    assert draw_spoil(Kind.LEG_ON_LEG, 7, 30) == draw_spoil(Kind.LEG_ON_LEG, 7, 30)
    assert {draw_spoil(Kind.LEG_ON_LEG, 7, frame).side for frame in range(20)} == {"Left", "Right"}


def test_choices_are_spread_evenly_and_never_repeated():
    assert spread(range(10), 5) == [1, 3, 5, 7, 9]
    assert spread(range(3), 5) == [0, 1, 2]
    assert spread(range(7), 0) == []


def test_wilsons_interval_is_the_published_one():
    """Newcombe 1998 (doi:10.1002/(SICI)1097-0258(19980430)17:8<857::AID-SIM777>3.0.CO;2-E), table I."""
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson(15, 148) == pytest.approx((0.0624, 0.1605), abs=1e-4)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)
    assert wilson(1, 29) == pytest.approx((0.0061, 0.1718), abs=1e-4)


def test_a_share_of_nothing_is_refused():
    with pytest.raises(ValueError, match="no share"):
        wilson(0, 0)


def test_a_paired_difference_has_students_interval():
    """Differences 1, 2, 3: mean 2, standard error 1 / sqrt(3), t of 2 degrees of freedom 4.3027."""
    found = paired_difference([2.0, 4.0, 6.0, np.nan], [1.0, 2.0, 3.0, 0.0])
    assert (found.pairs, found.mean) == (3, pytest.approx(2.0))
    assert (found.low, found.high) == pytest.approx((2.0 - 4.3027 / 3**0.5, 2.0 + 4.3027 / 3**0.5), abs=1e-4)
    assert paired_difference([1.0], [0.5]).low is None
    assert paired_difference([np.nan], [0.5]) is None
