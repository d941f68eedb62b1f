"""Poses that explain the pictures almost as well are kept until the pictures decide."""

import numpy as np
import pytest
from body_builder import adult_body, hide_bones, joint_errors_m, joints_of, seen_body, standing

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.limb_proposals import exchanged
from anchorpose.body.pose import PARTS, Pose
from anchorpose.body.registration import Registration
from anchorpose.body.rivals import (
    DECIDED,
    LIMB_ERROR,
    MEMORY_S,
    MOST,
    Rival,
    believed,
    follow_rivals,
    parts_apart,
    rivals_of,
    with_rivals,
)
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_INDEX
from anchorpose.simulate.render import TrueImage

BODY, CONFIG = adult_body(), RegistrationConfig()
TRUTH = standing(LeftArm=(60.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0))
WRONG = standing(LeftArm=(-20.0, 0.0, 70.0), RightArm=(-20.0, 0.0, 0.0))
SEEN = seen_body(TRUTH, BODY)


def sure(pose: Pose) -> PoseBelief:
    belief = vague_belief(pose)
    return PoseBelief(pose, belief.covariance / 400.0, belief.information * 400.0)


def registered(pose: Pose) -> Registration:
    return Registration(sure(pose), 1.0, True)


def test_without_rivals_nothing_changes():
    best = registered(TRUTH)
    assert follow_rivals(BODY, best, (), SEEN, 0.1, CONFIG) == (best, ())


def test_a_rival_that_explains_more_takes_the_place_of_the_best():
    first, left = follow_rivals(BODY, registered(WRONG), (Rival(sure(TRUTH), 0.0),), SEEN, 0.1, CONFIG)
    assert joint_errors_m(BODY, first.belief.pose, TRUTH).max() < 0.03
    assert left == ()  # the wrong pose is decided against at once


def test_a_rival_that_explains_less_is_dropped():
    best = registered(TRUTH)
    assert follow_rivals(BODY, best, (Rival(sure(WRONG), 0.0),), SEEN, 0.1, CONFIG) == (best, ())


def test_a_rival_that_became_the_best_pose_is_no_rival():
    best = registered(TRUTH)
    near = standing(LeftArm=(58.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0))
    assert follow_rivals(BODY, best, (Rival(sure(near), 0.0),), SEEN, 0.1, CONFIG) == (best, ())


ARM = tuple(f"Left{bone}" for bone in ("Shoulder", "Arm", "ForeArm", "Hand", "FingerBase", "HandFinger1"))


def without_arm(view: View, picture: TrueImage) -> View:
    """The left arm and all that is around the patient have no reading."""
    left = hide_bones(*ARM)(view, picture)
    labels = np.where(left.patient, left.labels, PixelLabel.NO_READING).astype(np.uint8)
    return View(np.where(left.patient, left.depth_m, np.float32(0.0)), labels)


LOW = standing(LeftArm=(45.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0))


def test_what_a_rival_lost_before_counts_less_with_every_frame():
    """An arm that is hidden decides nothing: only the lag of before is left, and it fades."""
    hidden = seen_body(TRUTH, BODY, change=without_arm)
    lags = []
    for before in (0.0, 1.0):
        _, left = follow_rivals(BODY, registered(TRUTH), (Rival(sure(LOW), before),), hidden, 0.02, CONFIG)
        lags.append(left[0].lag)
    assert lags[1] - lags[0] == pytest.approx(np.exp(-0.02 / MEMORY_S))


def test_a_rival_4_5_times_as_likely_takes_the_place_of_the_best():
    near = standing(LeftArm=(48.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0))
    best, seen = registered(near), seen_body(near, BODY)
    for lag, taken in ((-1.4, False), (-1.6, True)):
        first, _ = follow_rivals(BODY, best, (Rival(sure(TRUTH), lag),), seen, 1e-3, CONFIG)
        assert (first is not best) == taken


def test_two_poses_that_are_as_likely_do_not_take_turns():
    """No image shows the arm. After a rival has replaced the best pose, the old pose must gain more to return."""
    hidden, best = seen_body(TRUTH, BODY, change=without_arm), Registration(vague_belief(TRUTH), 1.0, True)
    low, (old,) = follow_rivals(BODY, best, (Rival(vague_belief(LOW), -1.7),), hidden, 1e-3, CONFIG)
    assert low is not best
    for gain, returned in ((2.5, False), (4.0, True)):  # nats
        gained = Rival(old.belief, old.lag - gain, old.moved)
        first, _ = follow_rivals(BODY, low, (gained,), hidden, 1e-3, CONFIG)
        assert (first is not low) == returned


def test_a_hidden_arm_does_not_move_without_an_image_of_it():
    """The rival's place is likelier by the images so far, but the arm was seen elsewhere a moment ago."""
    hidden, best = seen_body(TRUTH, BODY, change=without_arm), registered(TRUTH)
    first, (left,) = follow_rivals(BODY, best, (Rival(sure(LOW), -3.0),), hidden, 0.02, CONFIG)
    assert first is best
    assert left.moved > 1.0
    long_ago = Registration(vague_belief(TRUTH), 1.0, True)
    first, _ = follow_rivals(BODY, long_ago, (Rival(sure(LOW), -3.0),), hidden, 0.02, CONFIG)
    assert first is not long_ago


def test_hidden_legs_of_a_body_that_faces_the_other_way_cost_nothing():
    """The images of the trunk decide which way the patient faces; otherwise sigma would not show that it is open."""
    legs = tuple(f"{side}{bone}" for side in ("Left", "Right") for bone in ("UpLeg", "Leg", "Foot", "ToeBase"))

    def without_legs(view: View, picture: TrueImage) -> View:
        left = hide_bones(*legs)(view, picture)
        labels = np.where(left.patient, left.labels, PixelLabel.NO_READING).astype(np.uint8)
        return View(np.where(left.patient, left.depth_m, np.float32(0.0)), labels)

    *_, turned = exchanged(BODY, TRUTH)
    rival = Rival(sure(turned), 0.0, body=adult_body(1.72))
    seen = seen_body(TRUTH, BODY, change=without_legs)
    _, (left,) = follow_rivals(BODY, registered(TRUTH), (rival,), seen, 0.02, CONFIG)
    assert left.moved == 0.0


def test_the_advantage_of_a_rival_nearer_to_the_expected_pose_fades_like_a_cost():
    near = standing(LeftArm=(45.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0))
    seen = seen_body(TRUTH, BODY, change=without_arm)
    _, (left,) = follow_rivals(
        BODY, Registration(vague_belief(TRUTH), 1.0, True), (Rival(sure(near), 4.0, -2.0),), seen, 1e-4, CONFIG
    )
    assert -2.0 <= left.moved < -1.0


def test_a_lead_is_believed_by_its_own_error():
    """Of two classes a deviation apart, normally distributed: one in six is beyond it."""
    assert believed(LIMB_ERROR, 1) == pytest.approx(np.log(0.8413 / 0.1587), abs=1e-3)
    assert believed(PARTS * LIMB_ERROR, PARTS) == pytest.approx(believed(LIMB_ERROR, 1))
    assert believed(-30.0, 2) == -believed(30.0, 2)
    assert believed(0.5, 1) < 0.5
    assert believed(1e4, PARTS) == 1e4  # no error of shape makes that; the lead itself is all there is
    assert (np.diff([believed(lead, 3) for lead in np.linspace(-100.0, 100.0, 50)]) > 0.0).all()


def test_parts_that_lie_elsewhere_are_counted():
    _, legs, turned = exchanged(BODY, TRUTH)
    for pose, apart in ((TRUTH, 0), (WRONG, 1), (legs, 2), (turned, PARTS)):
        assert parts_apart(joints_of(BODY, TRUTH), joints_of(BODY, pose)) == apart


def test_a_rival_that_was_found_elsewhere_must_make_up_for_that_first():
    found = (Rival(sure(TRUTH), -40.0, 200.0),)
    best, left, frames = registered(WRONG), found, 0
    while left and left[0].behind > -DECIDED and frames < 20:
        first, left = follow_rivals(BODY, best, left, SEEN, 0.02, CONFIG)
        if first is not best:
            break
        frames += 1
    assert 1 <= frames < 20
    assert joint_errors_m(BODY, first.belief.pose, TRUTH).max() < 0.03


def test_few_rivals_are_kept_and_none_twice():
    poses = [standing(LeftArm=(angle, 0.0, 0.0)) for angle in (-60.0, -59.0, -35.0, -10.0, 20.0)]
    kept = rivals_of(BODY, sure(TRUTH), [Rival(sure(pose), 0.1 * k) for k, pose in enumerate(poses)])
    assert sorted(rival.lag for rival in kept) == pytest.approx([0.1 * k for k in (0, 2, 3)])
    assert len(kept) == MOST
    assert rivals_of(BODY, sure(TRUTH), [Rival(sure(WRONG), 1.1 * DECIDED)]) == ()


def test_a_body_that_is_turned_round_is_kept_before_likelier_places_of_a_hand():
    hands = [standing(LeftArm=(60.0, 0.0, 0.0), RightArm=(-20.0, 0.0, angle)) for angle in (15.0, 30.0, 45.0, 60.0)]
    *_, turned = exchanged(BODY, TRUTH)
    kept = rivals_of(BODY, sure(TRUTH), [*(Rival(sure(pose), 0.0) for pose in hands), Rival(sure(turned), 1.5)])
    assert turned in [rival.belief.pose for rival in kept]


def test_a_rival_with_a_body_of_its_own_is_part_of_sigma_and_never_the_best():
    tall = adult_body(height_m=1.9)
    first, left = follow_rivals(BODY, registered(WRONG), (Rival(sure(TRUTH), -12.0, body=tall),), SEEN, 0.1, CONFIG)
    np.testing.assert_array_equal(first.belief.pose.rotations, WRONG.rotations)
    (rival,) = left
    assert rival.body is tall
    assert rival.behind < -DECIDED
    np.testing.assert_array_equal(rival.joints_m(BODY), tall.joints(rival.belief.pose))


def test_leads_between_rivals_stay_what_they_are_when_one_becomes_the_best():
    one, other = Rival(sure(WRONG), -8.0, 1.0), Rival(sure(TRUTH), 2.0, 3.0)
    moved = other.beside(one)
    assert (moved.lag, moved.moved) == (10.0, 2.0)
    assert moved.behind == other.behind - one.behind


def test_sigma_is_that_of_the_mixture():
    joints, sigma = joints_of(BODY, TRUTH), np.full(21, 0.01)
    tie = with_rivals(BODY, joints, sigma, (Rival(sure(WRONG), 0.0),))
    apart = np.linalg.norm(joints_of(BODY, WRONG) - joints, axis=1)
    np.testing.assert_allclose(tie**2, sigma**2 + 0.5 * apart**2 / 3.0)
    hand = JOINT_INDEX["HandLeft"]
    assert tie[hand] > 0.1
    assert tie[JOINT_INDEX["Head"]] == pytest.approx(0.01)
    far = with_rivals(BODY, joints, sigma, (Rival(sure(WRONG), DECIDED),))
    assert far[hand] < 0.2 * tie[hand]
