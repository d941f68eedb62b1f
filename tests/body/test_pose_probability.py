"""How probable a pose is: the learnt descriptor's places beside the readings, and what is known of bodies."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import FRONT, adult_body, seen_body, standing

from anchorpose.body.limb_proposals import exchanged
from anchorpose.body.pose import LIMB_OF_BONES, MOVING_BONES, TRUNK
from anchorpose.body.pose_probability import FROM_BEFORE, facing_nats, log_probability, named_nats, places
from anchorpose.body.skin_points import body_points
from anchorpose.descriptor import learnt
from anchorpose.descriptor.learnt import Described
from anchorpose.isolation.view import PixelLabel

BODY = adult_body()
TRUTH = standing(LeftArm=(60.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0))
SEEN = seen_body(TRUTH, BODY)
LEFT_ARM, RIGHT_ARM = (int(LIMB_OF_BONES[MOVING_BONES.index(f"{side}ForeArm")]) for side in ("Left", "Right"))


def test_a_body_that_is_turned_round_or_has_its_sides_exchanged_is_named_otherwise():
    right, *others = (named_nats(BODY, pose, SEEN).sum() for pose in (TRUTH, *exchanged(BODY, TRUTH)))
    assert right > 15.0
    assert max(others) < right - 3.0
    assert others[-1] < 0.0  # turned round: likelier with any other skin


def test_limbs_that_are_exchanged_are_named_otherwise_and_others_are_not():
    right, arms = (named_nats(BODY, pose, SEEN).sum(axis=1) for pose in (TRUTH, next(iter(exchanged(BODY, TRUTH)))))
    lost = right - arms
    assert min(lost[LEFT_ARM], lost[RIGHT_ARM]) > 2.0
    assert np.abs(np.delete(lost, [TRUNK, LEFT_ARM, RIGHT_ARM])).max() < 0.5  # the trunk twists with the arms


def test_a_descriptor_that_is_wrong_everywhere_costs_as_much_as_wrong_places_are_frequent(monkeypatch):
    """Named to the millimetre, but each place at the other end of the body."""

    def wrong(depth_m: np.ndarray, camera: object) -> Described:
        said = learnt.describe(depth_m, FRONT)
        return said._replace(place=1.0 - said.place, error=np.where(said.person >= 0.5, 0.01, np.nan))

    monkeypatch.setattr("anchorpose.body.pose_probability.described", wrong)
    nats = named_nats(BODY, TRUTH, SEEN)
    assert nats.max() <= 0.0
    patches = nats.sum() / np.log(0.03)
    assert 5.0 < patches < 15.0  # a body from the front: 0.6 m2, in patches of 0.25 m


@pytest.mark.parametrize("label", [PixelLabel.OTHER_PERSON, PixelLabel.EQUIPMENT])
def test_what_is_named_of_others_says_nothing(label: PixelLabel):
    views = tuple(replace(view, labels=np.where(view.patient, np.uint8(label), view.labels)) for view in SEEN.views)
    np.testing.assert_array_equal(named_nats(BODY, TRUTH, replace(SEEN, views=views)), 0.0)


def test_the_pose_that_is_seen_is_the_most_probable_of_its_exchanges():
    right, *others = (log_probability(BODY, pose, SEEN) for pose in (TRUTH, *exchanged(BODY, TRUTH)))
    assert max(others) < right - 10.0


def test_places_are_those_of_the_standing_mean_adult():
    place = places(body_points())
    assert place[:, 1].min() == pytest.approx(0.0, abs=0.01)
    assert place[:, 1].max() == pytest.approx(1.0, abs=0.01)
    assert abs(place[:, 2].mean()) < 0.01  # as much to the left as to the right


def test_a_single_camera_is_expected_before_the_body_and_several_anywhere():
    *_, turned = exchanged(BODY, TRUTH)
    camera = SEEN.cameras[0]
    ahead, behind = (facing_nats(BODY, pose, [camera]) for pose in (TRUTH, turned))
    assert ahead - behind == pytest.approx(np.log(FROM_BEFORE), rel=0.02)
    assert ahead == pytest.approx(-behind, rel=0.05)
    assert facing_nats(BODY, TRUTH, [camera, camera]) == 0.0
