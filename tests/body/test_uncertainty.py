"""From the covariance of a pose to how far off each joint may be."""

import numpy as np
import pytest
from body_builder import adult_body, joints_of, points, random_pose, turned_about_y

from anchorpose.body.config import UncertaintyConfig
from anchorpose.body.pose import DEGREE, POSE_SIZE, Pose
from anchorpose.body.skin_points import pose_points
from anchorpose.body.uncertainty import CONSTANT_ERROR_M, joint_sigma, skin_sigma
from anchorpose.joints import JOINT_INDEX

BODY = adult_body()
POSE = random_pose(1)
KNEE = JOINT_INDEX["KneeRight"]


def sigma(covariance: np.ndarray, pose: Pose = POSE, **config: float) -> np.ndarray:
    settings = UncertaintyConfig(**{"floor_m": 0.006, "inflation": 1.0, **config})
    return joint_sigma(BODY, pose_points(BODY, pose), covariance, settings)


def some_covariance(seed: int) -> np.ndarray:
    factor = 0.05 * np.random.default_rng(seed).normal(size=(POSE_SIZE, POSE_SIZE)) / np.sqrt(POSE_SIZE)
    return factor @ factor.T


def least_m(floor_m: float) -> float:
    """Sigma of the joints of a pose that is known exactly."""
    return float(np.hypot(floor_m, CONSTANT_ERROR_M))


def test_a_pose_known_exactly_leaves_the_floor():
    least = least_m(0.007)
    np.testing.assert_allclose(sigma(np.zeros((POSE_SIZE, POSE_SIZE)), floor_m=0.007), least, rtol=1e-12)


def test_a_root_that_strays_takes_every_joint_with_it():
    variance = np.zeros(POSE_SIZE)
    variance[-3:] = 0.02**2
    np.testing.assert_allclose(sigma(np.diag(variance), floor_m=0.005), np.hypot(least_m(0.005), 0.02), rtol=1e-12)


def test_noise_and_coarse_pixels_add_to_what_is_known_exactly():
    """A root that strays by 20 mm with the noise takes every joint with it; two edges within 48 mm leave 9.8 mm."""
    nothing, noise = np.zeros((POSE_SIZE, POSE_SIZE)), np.zeros((POSE_SIZE, POSE_SIZE))
    noise[-3:, -3:] = 0.02**2 * np.eye(3)
    posed, config = pose_points(BODY, POSE), UncertaintyConfig(floor_m=0.005, inflation=0.5)
    found = joint_sigma(BODY, posed, nothing, config, noise, 0.048)
    np.testing.assert_allclose(found, np.hypot(np.hypot(least_m(0.005), 0.02), 0.0098), rtol=1e-3)


def test_skin_is_as_sure_as_the_part_it_moves_with():
    posed = pose_points(BODY, POSE)
    knee = list(points().moving).index(points().asset.bone("RightLeg"))
    variance = np.zeros(POSE_SIZE)
    variance[3 * knee : 3 * knee + 3] = (10.0 * DEGREE) ** 2
    found = skin_sigma(BODY, posed, np.diag(variance), UncertaintyConfig(floor_m=0.004, inflation=1.0))
    names = np.array(points().asset.bone_names)[points().part]
    below = np.isin(names, ["RightLeg", "RightFoot", "RightToeBase"])
    np.testing.assert_allclose(found[~below], 0.004, rtol=1e-9)
    assert (found[below] > 0.01).all()
    foot, shank = found[names == "RightFoot"], found[names == "RightLeg"]
    assert foot.min() > 1.5 * shank.max()  # twice as far from the knee as the middle of the shank
    shin_m = np.linalg.norm(posed.points_m[names == "RightLeg"].mean(axis=0) - joints_of(BODY, POSE)[KNEE])
    np.testing.assert_allclose(shank, np.hypot(0.004, 10.0 * DEGREE * shin_m * np.sqrt(2.0 / 3.0)), rtol=0.02)


def test_inflation_scales_what_the_posterior_says_and_not_the_floor():
    covariance = some_covariance(1)
    plain, inflated = sigma(covariance, floor_m=0.004), sigma(covariance, floor_m=0.004, inflation=3.0)
    least = least_m(0.004)
    np.testing.assert_allclose(inflated**2 - least**2, 9.0 * (plain**2 - least**2), rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_less_knowledge_is_never_less_sigma(seed):
    less = some_covariance(seed)
    more = less + some_covariance(seed + 10)
    assert (sigma(more) > sigma(less)).all()
    assert (sigma(less) >= 0.006).all()


def test_sigma_is_the_spread_of_the_joints_of_drawn_poses():
    """Monte Carlo oracle: draw poses from the covariance and look where the joints go."""
    rng = np.random.default_rng(4)
    variance = np.full(POSE_SIZE, (1.0 * DEGREE) ** 2)
    variance[-3:] = 0.005**2
    drawn = np.array(
        [
            joints_of(BODY, POSE.moved(rng.normal(size=POSE_SIZE) * np.sqrt(variance), points().moving))
            for _ in range(600)
        ]
    )
    spread = np.sqrt(drawn.var(axis=0).mean(axis=1))
    # 600 draws know a standard deviation to 3 %; turns of a degree are linear to less than that
    np.testing.assert_allclose(sigma(np.diag(variance), floor_m=1e-6), np.hypot(CONSTANT_ERROR_M, spread), rtol=0.1)


def test_a_doubtful_elbow_moves_wrist_and_hand_but_no_other_joint():
    variance = np.zeros(POSE_SIZE)
    row = points().moving.tolist().index(points().asset.bone("LeftForeArm"))
    variance[3 * row : 3 * row + 3] = 0.3**2
    found = sigma(np.diag(variance), floor_m=0.005)
    moved = {name for name, index in JOINT_INDEX.items() if found[index] > 1.01 * least_m(0.005)}
    assert moved == {"WristLeft", "HandLeft"}


def test_sigma_does_not_depend_on_where_the_patient_stands_and_faces():
    variance = np.full(POSE_SIZE, 0.05**2)
    there = turned_about_y(70.0, (2.0, 0.1, -1.0)).of_pose(POSE)
    np.testing.assert_allclose(sigma(np.diag(variance), there), sigma(np.diag(variance)), rtol=1e-9)


@pytest.mark.parametrize("wrong", [{"floor_m": 0.0}, {"inflation": -1.0}, {"floor_m": float("nan")}])
def test_a_configuration_that_cannot_work_is_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        UncertaintyConfig(**wrong)
