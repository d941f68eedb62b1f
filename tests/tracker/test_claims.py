"""A limb of the patient among another person's pixels is claimed, another person's limb is not."""

from types import SimpleNamespace

import numpy as np
import pytest
from body_builder import FRONT, LEFT, adult_body, evidence_of, joint_errors_m, points, standing
from mislabelled_builder import OTHER, pieces_of, seen

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.explanation import explain
from anchorpose.body.pose import Pose
from anchorpose.body.registration import Registration
from anchorpose.body.skin_points import pose_points
from anchorpose.camera import transform_points
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_INDEX
from anchorpose.tracker.limb_watch import claim_limb, hidden_limbs, limbs_in_doubt, spread_out

BODY = adult_body()
TRUTH = standing(LeftUpLeg=(0.0, 0.0, 35.0), LeftLeg=(0.0, 0.0, -25.0), RightArm=(-20.0, 0.0, 0.0))
WRONG = standing(LeftUpLeg=(0.0, 0.0, -20.0), LeftLeg=(0.0, 0.0, -50.0), RightArm=(-20.0, 0.0, 0.0))
"""The left leg is held forward; the tracker believes it to be behind the other one."""

SHANK = ("LeftLeg", "LeftFoot", "LeftToeBase")
RUN = SimpleNamespace(
    room=SimpleNamespace(cameras=(FRONT, LEFT)), config=SimpleNamespace(registration=RegistrationConfig())
)


def claimed(pose: Pose, observation):
    belief = vague_belief(pose)
    sure = PoseBelief(pose, belief.covariance / 100.0, belief.information * 100.0)
    explanation = explain(points(), pose_points(BODY, pose), observation.evidence)
    found = Registration(sure, 1.0, True)
    limbs = limbs_in_doubt(BODY, pose, explanation, observation)
    return claim_limb(BODY, limbs, found, sure, explanation, observation, RUN)


def test_a_shank_with_another_persons_label_is_found_and_gets_the_patients():
    observation = seen(TRUTH, SHANK)
    claim = claimed(WRONG, observation)
    ankle = JOINT_INDEX["AnkleLeft"]
    assert joint_errors_m(BODY, WRONG, TRUTH)[ankle] > 0.3
    assert joint_errors_m(BODY, claim.pose, TRUTH)[ankle] < 0.1
    for before, after in zip(observation.evidence.views, claim.views, strict=True):
        gained = after.patient & (before.labels == OTHER)
        assert gained.sum() > 0.8 * (before.labels == OTHER).sum()
        np.testing.assert_array_equal(after.depth_m, before.depth_m)


def test_nothing_is_claimed_while_every_limb_is_seen():
    observation = seen(TRUTH, ())
    explanation = explain(points(), pose_points(BODY, TRUTH), observation.evidence)
    assert hidden_limbs(BODY, explanation) == []
    assert limbs_in_doubt(BODY, TRUTH, explanation, observation) == []


def test_what_lies_out_of_the_limbs_reach_is_not_claimed():
    """The head has another label; the hidden shank cannot be there."""
    away = seen(TRUTH, (*SHANK, "Head"))
    views = []
    for view, camera in zip(away.evidence.views, (FRONT, LEFT), strict=True):
        low = transform_points(camera.require_pose(), camera.back_project(view.depth_m))[..., 1] < 0.8
        labels = np.where((view.labels == OTHER) & low, PixelLabel.NO_READING, view.labels).astype(np.uint8)
        views.append(View(view.depth_m, labels))
    away.evidence = evidence_of(views, (FRONT, LEFT))
    away.pieces = tuple(pieces_of(view, camera) for view, camera in zip(views, (FRONT, LEFT), strict=True))
    assert any((view.labels == OTHER).any() for view in views)
    assert claimed(WRONG, away) is None


@pytest.mark.parametrize("count", [0, 1, 5, 40])
def test_places_are_spread_out(count):
    places = np.random.default_rng(3).normal(size=(30, 3))
    chosen = spread_out(places, count)
    assert len(chosen) == min(count, 30)
    assert len(np.unique(chosen, axis=0)) == len(chosen)
