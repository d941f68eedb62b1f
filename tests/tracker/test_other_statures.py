"""Check the learnt stature where the images show it, and where they do not."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import TrueImage, asset, points, seen_body, standing

from anchorpose.body.belief import vague_belief
from anchorpose.body.learning import learn_body
from anchorpose.body.registration import descend
from anchorpose.body.shape_prior import ShapeBelief, adult_belief, shape_of_height, standing_height
from anchorpose.body.skin_points import build_body
from anchorpose.body.uncertainty import frame_errors
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.recording import UNKNOWN
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.other_statures import PosedFrame, frames_nats, with_other_statures

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


def between(one_m: float, other_m: float) -> ShapeBelief:
    """The belief that a body has one height, or as well another one; everything else is certain."""
    shape, sure = shape_of_height(asset(), one_m), 1e8 * ADULT.prior
    known = replace(ADULT, shape=shape).having_seen(shape, sure, sure @ ADULT.vector(shape))
    return known.including([shape_of_height(asset(), other_m)], np.ones(1))


def shape_sigma(frame: PosedFrame, shape: ShapeBelief) -> np.ndarray:
    """The part of the joints' sigma that follows from an uncertain shape."""
    return np.sqrt(frame_errors(PERSON, frame.pose, frame.evidence, CONFIG.registration, shape=shape).shape)


@pytest.fixture(scope="module", params=[False, True], ids=["whole", "feet cut off"])
def of_stature(request: pytest.FixtureRequest) -> tuple[bool, np.ndarray, np.ndarray]:
    """Sigma of the joints if the height is uncertain, and how far they lie apart if both bodies are registered."""
    frame, other_m = frames(request.param)[0], 1.65
    sigma_m = shape_sigma(frame, between(TRUE_M, other_m))
    bodies = (PERSON, build_body(points(), shape_of_height(asset(), other_m)))
    places = [
        body.joints(descend(body, frame.pose, vague_belief(frame.pose), frame.evidence, CONFIG.registration))
        for body in bodies
    ]
    return request.param, sigma_m, np.linalg.norm(places[1] - places[0], axis=1) / np.sqrt(3.0)


def test_joints_of_an_uncertain_stature_have_the_sigma_by_which_registered_bodies_differ(of_stature):
    _, sigma_m, apart_m = of_stature
    np.testing.assert_allclose(sigma_m, apart_m, atol=0.0015)


def test_another_stature_makes_joints_uncertain_where_no_skin_is_seen(of_stature):
    cut, sigma_m, _ = of_stature
    foot, head = sigma_m[JOINT_INDEX["FootLeft"]], sigma_m[JOINT_INDEX["Head"]]
    assert foot > 2.5 * head if cut else foot < 0.009


def test_a_certain_shape_adds_nothing():
    frame = frames(cut=True)[0]
    certain = between(TRUE_M, TRUE_M)
    assert shape_sigma(frame, certain).max() < 1e-4
