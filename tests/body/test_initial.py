"""The first pose, from nothing but what is seen."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import (
    adult,
    adult_body,
    asset,
    joint_errors_m,
    joints_of,
    points,
    seen_body,
    standing,
    turned_about_y,
)

from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import anchor_constraints, anchor_points
from anchorpose.body.evidence import Evidence
from anchorpose.body.initial import FirstPose, FirstShape, find_first_pose
from anchorpose.body.matched_places import MatchedPerson, match_person, matches_of
from anchorpose.body.pose import Pose
from anchorpose.body.shape_prior import adult_belief
from anchorpose.body.skin_points import build_body, pose_points
from anchorpose.geodesics.anchors import Anchors, no_anchors
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import ANCHOR_NAMES, JOINT_INDEX, JOINT_NAMES
from anchorpose.tracker.bystanders import rough_person
from anchorpose.tracker.patient_choice import HUMAN

BODY = adult_body()
UNSEEN = no_anchors()
STANDING = standing((0.05, 0.93, -0.04), LeftArm=(-20.0, 0.0, 10.0), RightArm=(15.0, 0.0, 5.0), Hips=(0.0, 8.0, 0.0))
SITTING = standing(
    (-0.1, 0.5, 0.0),
    LeftUpLeg=(0.0, 0.0, 75.0),
    RightUpLeg=(0.0, 0.0, 75.0),
    LeftLeg=(0.0, 0.0, -75.0),
    RightLeg=(0.0, 0.0, -75.0),
)
REACHING = standing(LeftArm=(80.0, 0.0, 0.0), RightArm=(20.0, 0.0, 0.0))


def tips_of(pose: Pose) -> Anchors:
    posed = pose_points(BODY, pose)
    return Anchors(np.arange(5, dtype=np.int32), posed.points_m[anchor_points(points())], np.full(5, 0.005))


def seen(truth: Pose) -> tuple[Evidence, MatchedPerson]:
    evidence = seen_body(truth, BODY)
    return evidence, match_person(matches_of(evidence.views, evidence.cameras, PixelLabel.PATIENT))


def first_pose(truth: Pose, height_m: float | None = None) -> FirstPose:
    shape = adult() if height_m is None else adult(height_m)
    guess = FirstShape([replace(adult_belief(asset()), shape=shape)], may_change=height_m is not None)
    return find_first_pose(*seen(truth), guess, RegistrationConfig())


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, pytest.param(180.0, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("truth", [STANDING, SITTING, REACHING], ids=["standing", "sitting", "reaching up"])
def test_a_known_body_is_found_whichever_way_it_faces(truth, heading_deg):
    truth = turned_about_y(heading_deg, (0.0, 0.0, 0.0)).of_pose(truth)
    found = first_pose(truth)
    hidden = heading_deg == 90.0  # the left side, beyond the right one
    shown = [number for number, name in enumerate(JOINT_NAMES) if not (hidden and name.endswith("Left"))]
    # 12 cm of last reach: registration brings the rest
    assert joint_errors_m(BODY, found.pose, truth)[shown].mean() < 0.015
    assert found.shape is adult()


def test_a_body_of_another_height_is_found_with_a_shape_that_gives_way():
    found = first_pose(STANDING, height_m=1.64)
    own = build_body(points(), found.shape)
    errors = np.linalg.norm(joints_of(own, found.pose) - joints_of(BODY, STANDING), axis=1)
    assert errors.mean() < 0.03
    height_m = float(np.ptp(found.shape.mesh(asset()).vertices[:, 1]))
    assert abs(height_m - 1.72) < 0.04  # half of what it was off


@pytest.mark.thorough
def test_the_same_evidence_gives_the_same_bits():
    first, again = (first_pose(STANDING) for _ in range(2))
    np.testing.assert_array_equal(first.pose.rotations, again.pose.rotations)
    assert first.log == again.log


def test_anchor_points_are_the_tips_of_the_body():
    tips = BODY.rest_m[anchor_points(points())]
    joints = BODY.mesh.rest_joints()
    for name, tip in zip(ANCHOR_NAMES, tips, strict=True):
        side = next((side for side in ("Left", "Right") if side.lower() in name.lower()), "")
        joint = next(part for part in ("Head", "Hand", "Foot") if part.lower() in name.lower())
        assert np.linalg.norm(tip - joints[JOINT_INDEX[joint + side]]) < 0.2, name
        if side:
            assert (tip[2] > 0.0) == (side == "Right")


def test_anchors_that_were_missed_hold_nothing():
    some = tips_of(STANDING)
    some.node[[1, 3]], some.position_m[[1, 3]] = -1, np.nan
    rows = anchor_constraints(points(), some)
    assert len(rows) == 9
    assert np.isfinite(rows.target_m).all()
    assert set(rows.point) == set(anchor_points(points())[[0, 2, 4]])
    assert len(anchor_constraints(points(), UNSEEN)) == 0


@pytest.mark.parametrize("knee_deg", [90.0, 100.0, 105.0, 110.0, 115.0])
def test_who_crouches_is_found_from_one_camera(knee_deg: float):
    """From the front; of who crouches with the back to the only camera the legs are taken for others."""
    knees = {f"{side}UpLeg": (35.0 * sign, 0.0, knee_deg) for side, sign in (("Left", 1.0), ("Right", -1.0))}
    shanks = {f"{side}Leg": (0.0, 0.0, -10.0 - knee_deg) for side in ("Left", "Right")}
    arms = {f"{side}Arm": (0.0, 0.0, 65.0) for side in ("Left", "Right")}
    bent = {"LowerBack": (0.0, 0.0, -30.0), "Spine": (0.0, 0.0, -20.0)}
    truth = standing((0.0, 0.45, 0.0), **knees, **shanks, **arms, **bent)
    evidence = seen_body(truth, BODY)
    found = rough_person(evidence.views, evidence.cameras, PixelLabel.PATIENT)
    off_m = np.linalg.norm(joints_of(found.body, found.found.belief.pose) - joints_of(BODY, truth), axis=1)
    assert off_m.mean() < 0.11
    assert found.found.explained > HUMAN
