"""Check the learnt stature where the images show it, and where they do not."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import TrueImage, asset, points, seen_body, standing

from anchorpose.body.learning import learn_body
from anchorpose.body.shape_prior import ShapeBelief, adult_belief, shape_of_height, standing_height
from anchorpose.body.skin_points import build_body
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.recording import UNKNOWN
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.other_statures import PosedFrame, frames_nats, other_shape, shape_sigma, with_other_statures

TRUE_M = 1.62
PERSON = build_body(points(), shape_of_height(asset(), TRUE_M))
POSES = [standing(LeftArm=(0.0, 0.0, angle), RightArm=(0.0, 0.0, -angle)) for angle in (0.0, 30.0, 60.0)]
ADULT, CONFIG = adult_belief(asset()), TrackConfig()


def feet_cut_off(view: View, _: TrueImage) -> View:
    """The same as if the image ended below the knees."""
    rows = np.flatnonzero(view.patient.any(axis=1))
    depth_m, labels = view.depth_m.copy(), view.labels.copy()
    last = int(rows[0] + 0.8 * np.ptp(rows))
    depth_m[last:], labels[last:] = 0.0, PixelLabel.NO_READING
    return View(depth_m, labels)


def frames(cut: bool) -> list[PosedFrame]:
    seen = [seen_body(pose, PERSON, change=feet_cut_off) if cut else seen_body(pose, PERSON) for pose in POSES]
    # without a floor, on which hidden feet would stand
    return [PosedFrame(pose, replace(one, floor_m=None)) for pose, one in zip(POSES, seen, strict=True)]


def learnt_from(some: list[PosedFrame], height_m: float) -> ShapeBelief:
    """The body is learnt from the mean adult of another height."""
    poses, evidence = zip(*some, strict=True)
    return learn_body(points(), shape_of_height(asset(), height_m), poses, evidence, ADULT, CONFIG.registration).belief


def height(belief: ShapeBelief) -> tuple[float, float]:
    """The standing height and its standard deviation."""
    height_m, row = standing_height(asset(), belief.shape)
    return height_m, float(np.sqrt(belief.variance(row[None])[0]))


@pytest.fixture(scope="module", params=[False, True], ids=["whole", "feet cut off"])
def doubted(request: pytest.FixtureRequest) -> tuple[bool, ShapeBelief, ShapeBelief]:
    some = frames(request.param)
    learnt = learnt_from(some, 1.78)
    return request.param, learnt, with_other_statures(learnt, ADULT, some, UNKNOWN, CONFIG)


def test_sigma_of_the_height_covers_its_error(doubted):
    cut, learnt, wide = doubted
    assert wide.shape is learnt.shape
    assert height(wide)[1] > height(learnt)[1]
    assert abs(height(wide)[0] - TRUE_M) < 2.0 * height(wide)[1]
    assert height(wide)[1] < (0.06 if cut else 0.015)


def test_a_body_of_another_stature_is_less_likely_the_more_of_it_is_seen():
    lead = [
        frames_nats(PERSON.shape, some, CONFIG) - frames_nats(shape_of_height(asset(), 1.08 * TRUE_M), some, CONFIG)
        for some in (frames(cut=True), frames(cut=False))
    ]
    assert 0.0 < lead[0] < 0.8 * lead[1]


def sigma_of(cut: bool, height_m: float) -> np.ndarray:
    """Sigma of the joints if the body may as well have another height."""
    other, frame = build_body(points(), shape_of_height(asset(), height_m)), frames(cut)[0]
    return shape_sigma(PERSON, other, frame.pose, frame.evidence, CONFIG.registration)


def test_another_stature_makes_joints_uncertain_where_no_skin_is_seen():
    foot, head = JOINT_INDEX["FootLeft"], JOINT_INDEX["Head"]
    seen, hidden = sigma_of(False, 1.70), sigma_of(True, 1.70)
    assert seen[[foot, head]].max() < 0.018
    assert hidden[foot] > 2.0 * seen[foot]
    assert hidden[foot] > 3.0 * hidden[head]
    assert sigma_of(True, TRUE_M).max() == 0.0  # the same body


def test_a_shape_counts_as_another_if_its_joints_differ_by_more_than_their_systematic_errors():
    sure = 1e6 * ADULT.prior
    known = ADULT.having_seen(PERSON.shape, sure, sure @ ADULT.vector(PERSON.shape))
    assert other_shape(known) is None
    other = shape_of_height(asset(), 1.75)
    taller = other_shape(known.including([other], np.array([0.5])))
    away_m = standing_height(asset(), taller)[0] - TRUE_M
    assert away_m == pytest.approx(0.13 * np.sqrt(0.5), rel=0.1)


def test_what_a_person_lacks_makes_no_shape_another():
    without = replace(PERSON.shape, missing=("leg_left", "leg_right"))
    sure = 1e6 * ADULT.prior
    legs = [asset().own_row(f"{segment}_length_{side}") for segment in ("thigh", "shank") for side in ("left", "right")]
    sure[legs] = sure[:, legs] = 0.0  # only the lengths of the legs are unknown
    for shape, differs in ((PERSON.shape, True), (without, False)):
        known = replace(ADULT, shape=shape).having_seen(shape, sure, sure @ ADULT.vector(shape))
        assert (other_shape(known) is not None) == differs
