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


@pytest.mark.parametrize("first", [0, 1])
def test_the_facing_is_right_whichever_the_trunk_favoured(found, first):
    evidence, right, turned = found
    facings = [(right, turned), (turned, replace(right, log=turned.log - 1.0))][first]
    best, rivals = search_facings(facings, (), None, evidence, CONFIG)
    assert joint_errors_m(BODY, best.first.pose, TRUTH).mean() < 0.02
    assert best.found.explained > 0.9
    assert all(rival.behind > 0.0 for rival in rivals)


@pytest.mark.parametrize("first", [0, 1])
def test_the_body_that_explains_more_after_the_search_is_taken(found, first):
    """A search moves limbs, but not the shape: a body of another height stays behind, whatever its rank before."""
    evidence, right, _ = found
    small = replace(right, belief=replace(right.belief, shape=adult(1.5)), log=right.log + (100.0 if first else -100.0))
    best, _ = search_facings([(right, small), (small, right)][first], (), None, evidence, CONFIG)
    assert best.first.shape is right.shape


def test_a_facing_that_no_body_explains_is_not_found(found):
    evidence, _, turned = found
    away = replace(turned, pose=replace(turned.pose, root_m=turned.pose.root_m + 2.0))
    best, rivals = search_facings([away], (), None, evidence, CONFIG)
    assert not best.found.found
    assert rivals == ()
