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
    joints_of,
    photograph,
    points,
    random_pose,
    shaken,
)

from anchorpose.body.evidence import Evidence
from anchorpose.body.initial import shape_of_height
from anchorpose.body.learning import LearnedBody, LearningConfig, learn_body
from anchorpose.body.pose import Pose
from anchorpose.body.registration import RegistrationConfig
from anchorpose.body.skin_points import FittedShape, rest_points
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES

POSES = [random_pose(seed, 0.5) for seed in (20, 21, 22, 24, 25, 26)]  # 23 puts a hand through the groin
LIMBS = [
    (JOINT_INDEX[start + side], JOINT_INDEX[end + side])
    for start, end in (("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Hip", "Knee"), ("Knee", "Ankle"))
    for side in ("Left", "Right")
]
COEFFICIENTS = np.random.default_rng(3).normal(0.0, 0.7, 16).clip(-1.5, 1.5)


def pictures_of(shape: FittedShape, poses: list[Pose]) -> list[Evidence]:
    return [evidence_of((before_wall(photograph(dressed_in(pose, shape), FRONT), FRONT),), (FRONT,)) for pose in poses]


def learnt(shape: FittedShape, poses: list[Pose]) -> LearnedBody:
    """From the adult of the same height, and poses that are a few centimetres off."""
    height_m = float(np.ptp(shape.body(asset()).vertices[:, 1]))
    start = shape_of_height(asset(), height_m)
    rough = [shaken(pose, 40 + k, turn_deg=2.0, shift_m=0.015) for k, pose in enumerate(poses)]
    return learn_body(points(), start, rough, pictures_of(shape, poses), LearningConfig(), RegistrationConfig())


def limb_lengths_m(shape: FittedShape) -> np.ndarray:
    joints = shape.body(asset()).rest_joints()
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
    np.testing.assert_allclose(limb_lengths_m(naked.shape), truth, rtol=0.012)


def test_trunk_and_neck_are_learnt_too(naked):
    height_m = float(np.ptp(FittedShape(COEFFICIENTS, 0.0).body(asset()).vertices[:, 1]))
    truth, start = FittedShape(COEFFICIENTS, 0.0), shape_of_height(asset(), height_m)
    before, after = (
        np.abs(shape.body(asset()).rest_joints() - truth.body(asset()).rest_joints()).max()
        for shape in (start, naked.shape)
    )
    assert before > 0.015
    assert after < 0.5 * before


def test_joints_of_the_learnt_poses_are_those_of_the_body_that_was_seen(naked):
    true_rest = rest_points(points(), FittedShape(COEFFICIENTS, 0.0))
    own_rest = rest_points(points(), naked.shape)
    for pose, truth in zip(naked.poses, POSES, strict=True):
        errors = np.linalg.norm(joints_of(own_rest, pose) - joints_of(true_rest, truth), axis=1)
        assert errors.mean() < 0.006
        assert errors.max() < 0.02, JOINT_NAMES[errors.argmax()]


def test_clothes_are_told_from_flesh(naked, dressed):
    assert dressed.shape.clothing_m > 0.003
    assert dressed.shape.clothing_m - naked.shape.clothing_m > 0.003
    assert abs(naked.shape.clothing_m) < 0.003
    truth = limb_lengths_m(FittedShape(COEFFICIENTS, 0.0))
    np.testing.assert_allclose(limb_lengths_m(dressed.shape), truth, rtol=0.02)


def test_the_learnt_shape_is_an_adults(naked, dressed):
    for body in (naked, dressed):
        assert np.isfinite(body.shape.coefficients).all()
        assert np.abs(body.shape.coefficients).max() < 3.0


def test_the_same_frames_give_the_same_bits():
    shape = FittedShape(COEFFICIENTS, 0.0)
    first, again = (learnt(shape, POSES[:2]) for _ in range(2))
    np.testing.assert_array_equal(first.shape.coefficients, again.shape.coefficients)
    assert first.shape.clothing_m == again.shape.clothing_m


def test_the_order_of_the_frames_does_not_matter():
    shape = FittedShape(COEFFICIENTS, 0.0)
    evidence, start = pictures_of(shape, POSES[:3]), shape_of_height(asset(), 1.75)
    one = learn_body(points(), start, POSES[:3], evidence, LearningConfig(), RegistrationConfig())
    other = learn_body(points(), start, POSES[2::-1], evidence[::-1], LearningConfig(), RegistrationConfig())
    np.testing.assert_allclose(one.shape.coefficients, other.shape.coefficients, atol=1e-5)


def test_a_body_without_frames_is_refused():
    with pytest.raises(ValueError, match="at least one frame"):
        learn_body(points(), FittedShape(COEFFICIENTS, 0.0), [], [], LearningConfig(), RegistrationConfig())


@pytest.mark.parametrize("wrong", [{"window_s": 0.0}, {"frame_count": 0}, {"reaches_m": ()}, {"reaches_m": (0.1, 0.0)}])
def test_a_configuration_that_cannot_work_is_refused(wrong):
    with pytest.raises(ValueError, match="must be positive"):
        LearningConfig(**wrong)
