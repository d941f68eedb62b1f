"""The patient's own shape, bone lengths and clothing, from several frames."""

from __future__ import annotations

import numpy as np
import pytest
from body_builder import (
    FRONT,
    asset,
    before_wall,
    dressed_in,
    evidence_of,
    hide_bones,
    joints_of,
    photograph,
    points,
    random_pose,
    seen_body,
    shaken,
)

from anchorpose.body.config import LearningConfig, RegistrationConfig
from anchorpose.body.evidence import Evidence
from anchorpose.body.learning import LearnedBody, bone_lengths, learn_body
from anchorpose.body.pose import Pose
from anchorpose.body.shape_prior import ShapeBelief, adult_belief, shape_of_height
from anchorpose.body.skin_points import FittedShape, build_body
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES

POSES = [random_pose(seed, 0.5) for seed in (20, 21, 22, 24, 25, 26)]  # 23 puts a hand through the groin
LIMBS = [
    (JOINT_INDEX[start + side], JOINT_INDEX[end + side])
    for start, end in (("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Hip", "Knee"), ("Knee", "Ankle"))
    for side in ("Left", "Right")
]
NOTHING = adult_belief(asset())  # is known but that the patient is an adult
COEFFICIENTS = np.random.default_rng(3).normal(0.0, 0.7, 16).clip(-1.5, 1.5)


def pictures_of(shape: FittedShape, poses: list[Pose]) -> list[Evidence]:
    return [evidence_of((before_wall(photograph(dressed_in(pose, shape), FRONT), FRONT),), (FRONT,)) for pose in poses]


def learnt(shape: FittedShape, poses: list[Pose]) -> LearnedBody:
    """From the adult of the same height, and poses that are a few centimetres off."""
    height_m = float(np.ptp(shape.mesh(asset()).vertices[:, 1]))
    start = shape_of_height(asset(), height_m)
    rough = [shaken(pose, 40 + k, turn_deg=2.0, shift_m=0.015) for k, pose in enumerate(poses)]
    return learn_body(points(), start, rough, pictures_of(shape, poses), NOTHING, RegistrationConfig())


def limb_lengths_m(shape: FittedShape) -> np.ndarray:
    joints = shape.mesh(asset()).rest_joints()
    start, end = np.array(LIMBS).T
    return np.linalg.norm(joints[start] - joints[end], axis=1)


@pytest.fixture(scope="module")
def naked() -> LearnedBody:
    return learnt(FittedShape(COEFFICIENTS, 0.0), POSES)


@pytest.fixture(scope="module")
def dressed() -> LearnedBody:
    return learnt(FittedShape(COEFFICIENTS, 0.008), POSES)


def test_limbs_get_their_length_from_six_poses(naked):
    truth = limb_lengths_m(FittedShape(COEFFICIENTS, 0.0))
    # noise-free depth: what remains is the prior, which keeps 1 % of a length that one camera sees only from the front
    np.testing.assert_allclose(limb_lengths_m(naked.belief.shape), truth, rtol=0.012)


def test_trunk_and_neck_are_learnt_too(naked):
    height_m = float(np.ptp(FittedShape(COEFFICIENTS, 0.0).mesh(asset()).vertices[:, 1]))
    truth, start = FittedShape(COEFFICIENTS, 0.0), shape_of_height(asset(), height_m)
    before, after = (
        np.abs(shape.mesh(asset()).rest_joints() - truth.mesh(asset()).rest_joints()).max()
        for shape in (start, naked.belief.shape)
    )
    assert before > 0.015
    assert after < 0.5 * before


def test_joints_of_the_learnt_poses_are_those_of_the_body_that_was_seen(naked):
    true_rest = build_body(points(), FittedShape(COEFFICIENTS, 0.0))
    own_rest = build_body(points(), naked.belief.shape)
    for pose, truth in zip(naked.poses, POSES, strict=True):
        errors = np.linalg.norm(joints_of(own_rest, pose) - joints_of(true_rest, truth), axis=1)
        assert errors.mean() < 0.006
        assert errors.max() < 0.02, JOINT_NAMES[errors.argmax()]


def test_clothes_are_distinguished_from_flesh(naked, dressed):
    assert dressed.belief.shape.clothing_m > 0.003
    assert dressed.belief.shape.clothing_m - naked.belief.shape.clothing_m > 0.003
    assert abs(naked.belief.shape.clothing_m) < 0.003
    truth = limb_lengths_m(FittedShape(COEFFICIENTS, 0.0))
    np.testing.assert_allclose(limb_lengths_m(dressed.belief.shape), truth, rtol=0.02)


def test_the_learnt_shape_is_an_adults(naked, dressed):
    for body in (naked, dressed):
        assert np.isfinite(body.belief.shape.coefficients).all()
        assert np.abs(body.belief.shape.coefficients).max() < 3.0


def test_the_same_frames_give_the_same_bits():
    shape = FittedShape(COEFFICIENTS, 0.0)
    first, again = (learnt(shape, POSES[:2]) for _ in range(2))
    np.testing.assert_array_equal(first.belief.shape.coefficients, again.belief.shape.coefficients)
    assert first.belief.shape.clothing_m == again.belief.shape.clothing_m


def test_the_order_of_the_frames_does_not_matter():
    shape = FittedShape(COEFFICIENTS, 0.0)
    evidence, start = pictures_of(shape, POSES[:3]), shape_of_height(asset(), 1.75)
    one = learn_body(points(), start, POSES[:3], evidence, NOTHING, RegistrationConfig())
    other = learn_body(points(), start, POSES[2::-1], evidence[::-1], NOTHING, RegistrationConfig())
    np.testing.assert_allclose(one.belief.shape.coefficients, other.belief.shape.coefficients, atol=1e-5)


def test_a_body_without_frames_is_refused():
    with pytest.raises(ValueError, match="at least one frame"):
        learn_body(points(), FittedShape(COEFFICIENTS, 0.0), [], [], NOTHING, RegistrationConfig())


@pytest.mark.parametrize("wrong", [{"window_s": 0.0}, {"frame_count": 0}, {"longest_s": -1.0}, {"height_sigma_m": 0.0}])
def test_a_configuration_that_cannot_work_is_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        LearningConfig(**wrong)


SHANKS = [number for number, (start, _) in enumerate(LIMBS) if JOINT_NAMES[start].startswith("Knee")]
WITHOUT_LEGS = hide_bones("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase",
                          "RightUpLeg", "RightLeg", "RightFoot", "RightToeBase")  # fmt: skip


@pytest.fixture(scope="module")
def windows() -> tuple[ShapeBelief, ShapeBelief]:
    """After frames that hide the legs, and after some more that show them."""
    body = build_body(points(), FittedShape(COEFFICIENTS, 0.0))
    known, shape, after = NOTHING, shape_of_height(asset(), 1.70), []
    for poses, change in ((POSES[:3], WITHOUT_LEGS), (POSES[3:], None)):
        evidence = [seen_body(pose, body, change=change) if change else seen_body(pose, body) for pose in poses]
        rough = [shaken(pose, 60 + k, turn_deg=2.0, shift_m=0.015) for k, pose in enumerate(poses)]
        known = learn_body(points(), shape, rough, evidence, known, RegistrationConfig()).belief
        shape = known.shape
        after.append(known)
    return after[0], after[1]


def test_what_was_hidden_is_uncertain_and_settles_when_it_is_seen(windows):
    truth = limb_lengths_m(FittedShape(COEFFICIENTS, 0.0))
    before, after = (np.abs(limb_lengths_m(belief.shape) - truth)[SHANKS] for belief in windows)
    sigma = [np.array([bone.sigma_m for bone in bone_lengths(asset(), belief)])[SHANKS] for belief in windows]
    assert sigma[0].min() > 1.3 * sigma[1].max()
    assert before.max() < 3.0 * sigma[0].max()  # it was known how little was known
    assert after.max() < min(0.010, before.max())


def test_more_frames_never_make_the_shape_less_certain(windows):
    first, second = windows
    assert np.linalg.eigvalsh(second.information - first.information).min() > -1e-6


def test_frames_hardly_change_what_is_well_known():
    """Frames of a person a hand taller hardly change a shape of which much was seen before."""
    stranger = np.array(COEFFICIENTS)
    stranger[0] += 0.5
    body = build_body(points(), FittedShape(stranger, 0.0))
    own = FittedShape(COEFFICIENTS, 0.0)
    known = ShapeBelief(own, 1e6 * NOTHING.information)
    evidence = [seen_body(pose, body) for pose in POSES[:2]]
    learned = learn_body(points(), own, POSES[:2], evidence, known, RegistrationConfig())
    np.testing.assert_allclose(limb_lengths_m(learned.belief.shape), limb_lengths_m(own), atol=0.003)
