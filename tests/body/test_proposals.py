"""Where poses are proposed from: each source by itself, and none when all are switched off."""

import numpy as np
import pytest
from body_builder import adult_body, joint_errors_m, seen_body, standing

from anchorpose.body.config import Source
from anchorpose.body.proposals import MOST_UNUSUAL, SOURCES, Doubted, proposals, rarity
from anchorpose.geodesics.anchors import SeenAnchors, no_anchors
from anchorpose.joints import JOINT_INDEX

BODY = adult_body()
TRUTH = standing(LeftArm=(70.0, 0.0, 0.0))
WRONG = standing(LeftArm=(-20.0, 0.0, 0.0))
SEEN = seen_body(TRUTH, BODY)
NOTHING_FOUND = SeenAnchors(SEEN.surface, no_anchors())


def proposed(*sources: Source, anchors: SeenAnchors | None = NOTHING_FOUND) -> list:
    return list(proposals(Doubted(BODY, WRONG, SEEN, anchors), sources))


def test_every_source_is_there():
    assert set(SOURCES) == set(Source)


def test_without_sources_nothing_is_proposed():
    assert proposed() == []


@pytest.mark.parametrize("source", [Source.SURFACE, Source.DESCRIPTOR])
def test_the_raised_arm_is_proposed_by_each_source_that_sees_it(source):
    hands_m = [joint_errors_m(BODY, pose, TRUTH)[JOINT_INDEX["WristLeft"]] for pose in proposed(source)]
    assert min(hands_m) < 0.2 < joint_errors_m(BODY, WRONG, TRUTH)[JOINT_INDEX["WristLeft"]]


def test_the_descriptor_proposes_both_ways_to_face_but_not_again_for_a_first_pose():
    one, other = proposed(Source.DESCRIPTOR)
    sides = [
        BODY.joints(pose)[JOINT_INDEX["ShoulderLeft"]] - BODY.joints(pose)[JOINT_INDEX["ShoulderRight"]]
        for pose in (one, other)
    ]
    assert np.dot(*sides) < 0.0
    assert proposed(Source.DESCRIPTOR, anchors=None) == []


def test_limbs_that_are_bent_much_more_are_left_out():
    most = rarity(BODY, WRONG) + MOST_UNUSUAL
    assert all(rarity(BODY, pose) <= most for pose in proposed(Source.SURFACE, Source.ANCHORS, Source.DESCRIPTOR))
