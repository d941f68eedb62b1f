"""Which way a person faces is decided by the whole body."""

from dataclasses import replace

import pytest
from body_builder import adult, adult_body, asset, joint_errors_m, seen_body, standing

from anchorpose.body.config import RegistrationConfig
from anchorpose.body.evidence import Evidence
from anchorpose.body.facings import search_facings
from anchorpose.body.initial import FirstPose, FirstShape, find_first_pose
from anchorpose.body.matched_places import match_person, matches_of
from anchorpose.body.shape_prior import adult_belief
from anchorpose.isolation.view import PixelLabel

TRUTH = standing((0.05, 0.93, -0.04), LeftArm=(-20.0, 0.0, 10.0), RightArm=(15.0, 0.0, 5.0), LeftUpLeg=(0.0, 0.0, 40.0))
BODY, CONFIG = adult_body(), RegistrationConfig()


@pytest.fixture(scope="module")
def found() -> tuple[Evidence, FirstPose, FirstPose]:
    evidence = seen_body(TRUTH, BODY)
    person = match_person(matches_of(evidence.views, evidence.cameras, PixelLabel.PATIENT))
    known = FirstShape([replace(adult_belief(asset()), shape=adult())], may_change=False)
    first = find_first_pose(evidence, person, known, CONFIG)
    return evidence, first, first.others[0]


@pytest.mark.parametrize("likelier_before", [True, False])
def test_the_facing_whose_limbs_are_explained_is_taken_although_the_trunk_favoured_the_other(found, likelier_before):
    evidence, right, turned = found
    if not likelier_before:
        right, turned = replace(right, log=turned.log), replace(turned, log=right.log)
    facings = (right, turned) if likelier_before else (turned, right)
    best, rivals = search_facings(facings, (), None, evidence, CONFIG)
    assert joint_errors_m(BODY, best.first.pose, TRUTH).mean() < 0.02
    assert best.found.explained > 0.9
    assert all(rival.behind > 0.0 for rival in rivals)


def test_a_facing_that_no_body_explains_is_not_found(found):
    evidence, _, turned = found
    away = replace(turned, pose=replace(turned.pose, root_m=turned.pose.root_m + 2.0))
    best, rivals = search_facings([away], (), None, evidence, CONFIG)
    assert not best.found.found
    assert rivals == ()
