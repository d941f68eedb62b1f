"""What is known of a shape: a measured height, bone lengths and their sigma."""

from __future__ import annotations

import numpy as np
import pytest
from body_builder import asset

from anchorpose.body.learning import BONES, MOST_DEVIATIONS, bone_lengths
from anchorpose.body.shape_prior import ShapeBelief, adult_belief, standing_height
from anchorpose.body.skin_points import FittedShape
from anchorpose.joints import JOINT_INDEX

ADULT = adult_belief(asset())


def spread_m(belief: ShapeBelief) -> float:
    """One standard deviation of the standing height."""
    row = standing_height(asset(), belief.shape)[1]
    return float(np.sqrt(belief.variance(row[None])[0]))


def lengths_m(shape: FittedShape) -> np.ndarray:
    joints = shape.mesh(asset()).rest_joints()
    return np.array([np.linalg.norm(joints[JOINT_INDEX[a]] - joints[JOINT_INDEX[b]]) for _, a, b in BONES])


@pytest.mark.parametrize("height_m", [1.5, 1.72, 1.9])
def test_an_adult_of_a_measured_height_has_it_to_a_centimetre(height_m):
    known = adult_belief(asset()).standing(asset(), height_m, 0.01)
    assert standing_height(asset(), known.shape)[0] == pytest.approx(height_m, abs=0.002)
    assert spread_m(known) == pytest.approx(0.01, rel=0.02)
    assert spread_m(ADULT) > 0.05


def test_a_height_says_nothing_of_clothes_and_little_of_what_leaves_it_alone():
    known = adult_belief(asset()).standing(asset(), 1.9, 0.01)
    assert known.shape.clothing_m == pytest.approx(ADULT.shape.clothing_m)
    gained = np.linalg.eigvalsh(known.information - ADULT.information)
    np.testing.assert_allclose(gained[:-1], 0.0, atol=1e-6 * gained[-1])  # one number says one thing


def test_a_height_that_is_met_moves_nothing():
    own_m = standing_height(asset(), ADULT.shape)[0]
    np.testing.assert_allclose(adult_belief(asset()).standing(asset(), own_m, 0.01).shape.coefficients, 0.0, atol=1e-9)


@pytest.mark.parametrize("height_m", [1.2, 2.2])
def test_no_height_makes_a_body_that_no_adult_has(height_m):
    coefficients = adult_belief(asset()).standing(asset(), height_m, 0.01).shape.coefficients
    assert np.abs(coefficients).max() <= MOST_DEVIATIONS


def test_the_heights_derivative_is_its_slope():
    shape = FittedShape(np.linspace(-0.5, 0.5, asset().shape_count), 0.006)
    own_m, row = standing_height(asset(), shape)
    for k in range(asset().shape_count):
        moved = FittedShape(shape.coefficients + 1e-6 * (np.arange(asset().shape_count) == k), 0.006)
        assert (standing_height(asset(), moved)[0] - own_m) / 1e-6 == pytest.approx(row[k], abs=1e-6)


def test_bone_lengths_and_their_sigma_are_those_of_many_drawn_bodies():
    rng, count = np.random.default_rng(5), asset().shape_count
    square = rng.normal(size=(count + 1, count + 1))
    information = square @ square.T + 200.0 * np.eye(count + 1)
    belief = ShapeBelief(FittedShape(rng.normal(0.0, 0.5, count), 0.005), information)
    found = bone_lengths(asset(), belief)
    np.testing.assert_allclose([bone.length_m for bone in found], lengths_m(belief.shape), atol=1e-12)
    drawn = rng.multivariate_normal(
        np.append(belief.shape.coefficients, 0.0), np.linalg.inv(information), 2000
    )[:, :-1]  # fmt: skip
    spread = np.std([lengths_m(FittedShape(coefficients, 0.0)) for coefficients in drawn], axis=0)
    np.testing.assert_allclose([bone.sigma_m for bone in found], spread, rtol=0.08)  # 2,000 draws: 1.6 % each
