"""Poses that explain the pictures almost as well are kept until the pictures decide."""

import numpy as np
import pytest
from body_builder import adult_body, hide_bones, joint_errors_m, joints_of, seen_body, standing

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.limb_search import DECIDED, MEMORY, Rival, follow_rivals, with_rivals
from anchorpose.body.pose import Pose
from anchorpose.body.registration import Registration
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


def test_what_a_rival_lost_before_counts_less_with_every_frame():
    """An arm that is hidden decides nothing: only the lag of before is left, and it fades."""
    arm = tuple(f"Left{bone}" for bone in ("Shoulder", "Arm", "ForeArm", "Hand", "FingerBase", "HandFinger1"))
    hide = hide_bones(*arm)

    def nothing_else(view: View, picture: TrueImage) -> View:
        left = hide(view, picture)
        labels = np.where(left.patient, left.labels, PixelLabel.NO_READING).astype(np.uint8)
        return View(np.where(left.patient, left.depth_m, np.float32(0.0)), labels)

    hidden = seen_body(TRUTH, BODY, change=nothing_else)
    low = standing(LeftArm=(45.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0))
    lags = []
    for before in (0.0, 1.0):
        _, left = follow_rivals(BODY, registered(TRUTH), (Rival(sure(low), before),), hidden, 0.02, CONFIG)
        lags.append(left[0].lag)
    assert lags[1] - lags[0] == pytest.approx(MEMORY)


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
