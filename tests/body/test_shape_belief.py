"""What is known of a shape: a prior with tails, what was seen, a measured height, bone lengths and their sigma."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import asset
from scipy.stats import t as student

from anchorpose.body.learning import BONES, SYSTEMATIC_M, bone_lengths
from anchorpose.body.segments import GIRTH_SIGMA, LENGTH_SIGMA, SIDES
from anchorpose.body.shape_prior import TAILS, THICKEST_M, ShapeBelief, adult_belief, child_belief, standing_height
from anchorpose.body.shape_rows import FreeShape
from anchorpose.body.skin_points import CLOTHES, OFFSETS, FittedShape, even_clothes
from anchorpose.joints import JOINT_INDEX
from anchorpose.tracker.start import MOST_DEVIATIONS

ADULT = adult_belief(asset())
SIZE = sum(ADULT.free)
COMMON, SHAPES = asset().common_count, asset().shape_count
COVARIANCE = np.linalg.inv(ADULT.prior)
BOTH = pytest.mark.parametrize("group", [adult_belief, child_belief])


def spread_m(belief: ShapeBelief) -> float:
    """One standard deviation of the standing height."""
    row = standing_height(asset(), belief.shape)[1]
    return float(np.sqrt(belief.variance(row[None])[0]))


def lengths_m(shape: FittedShape) -> np.ndarray:
    joints = shape.mesh(asset()).rest_joints()
    return np.array([np.linalg.norm(joints[JOINT_INDEX[a]] - joints[JOINT_INDEX[b]]) for _, a, b in BONES])


def shape_at(vector: np.ndarray) -> FittedShape:
    return FittedShape(vector[:SHAPES].copy(), vector[SHAPES:].copy())


def own(name: str) -> int:
    """The place of a person's own direction among the parameters."""
    return COMMON + asset().own_names.index(name)


def some_information(seed: int, rank: int = 40) -> np.ndarray:
    """Of ``rank`` observations, about as certain as the prior."""
    rows = np.random.default_rng(seed).normal(size=(rank, SIZE)) / np.sqrt(np.diag(COVARIANCE))
    return rows.T @ rows / SIZE


@BOTH
def test_before_anything_is_seen_the_prior_is_all_that_is_known_and_pulls_nowhere(group):
    known = group(asset())
    np.testing.assert_array_equal(known.vector(known.shape), known.mean)
    hessian, gradient = known.equations(known.shape)
    assert not gradient.any()
    np.testing.assert_array_equal(hessian, known.information)
    assert known.cost(known.shape) == 0.0
    assert not known.deviations(known.shape).any()
    # where nothing is unusual, tails make the prior a quarter more certain, and no more
    weight = np.where(known.soft, (TAILS + 1.0) / TAILS, 1.0)
    np.testing.assert_allclose(known.information, known.prior * np.sqrt(np.outer(weight, weight)), rtol=1e-12)


@BOTH
def test_statistical_components_have_no_tails_and_what_is_a_persons_own_has(group):
    known = group(asset())
    assert known.free == FreeShape(SHAPES, OFFSETS)
    assert not known.soft[:COMMON].any()
    assert known.soft[COMMON:].all()


def test_every_own_direction_has_a_deviation_of_one():
    np.testing.assert_allclose(np.diag(COVARIANCE)[COMMON:SHAPES], 1.0)
    np.testing.assert_allclose(COVARIANCE[:COMMON, COMMON:], 0.0, atol=1e-12)
    np.testing.assert_allclose(COVARIANCE[:SHAPES, SHAPES:], 0.0, atol=1e-12)


@BOTH
def test_correlations_are_positive_definite(group):
    prior = group(asset()).prior
    np.testing.assert_allclose(prior, prior.T, rtol=1e-9, atol=1e-9)
    deviation = np.sqrt(np.diag(np.linalg.inv(prior)))
    assert np.linalg.eigvalsh(prior * np.outer(deviation, deviation)).min() > 0.01


def test_left_and_right_are_known_alike():
    names = asset().own_names
    other = {"left": "right", "right": "left"}
    swapped = [
        own(name.rsplit("_", 1)[0] + "_" + other[side] if (side := name.rsplit("_", 1)[-1]) in other else name)
        for name in names
    ]
    plain = [own(name) for name in names]
    assert swapped != plain
    np.testing.assert_allclose(COVARIANCE[np.ix_(swapped, swapped)], COVARIANCE[np.ix_(plain, plain)], atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "segments", "least"),
    [("length", LENGTH_SIGMA, 0.85), ("girth", GIRTH_SIGMA, 0.7), ("size", ("hand", "foot"), 0.9)],
)
def test_the_two_sides_are_more_alike_than_any_two_segments(kind, segments, least):
    both = [COVARIANCE[own(f"{segment}_{kind}_left"), own(f"{segment}_{kind}_right")] for segment in segments]
    others = [
        COVARIANCE[own(f"{one}_{kind}_{side}"), own(f"{other}_{kind}_{beside}")]
        for one in segments
        for other in segments
        if one != other
        for side in SIDES
        for beside in SIDES
    ]
    assert least < min(both) <= max(both) < 1.0
    assert max(others) < min(both)
    assert min(others) > -1e-12


def test_paralysed_legs_are_thin_from_hip_to_ankle_under_arms_of_any_girth():
    for side in SIDES:
        thigh, shank, arm = (own(f"{segment}_girth_{side}") for segment in ("thigh", "shank", "upper_arm"))
        assert COVARIANCE[thigh, shank] == pytest.approx(0.6)
        assert COVARIANCE[thigh, arm] == pytest.approx(0.0, abs=1e-12)
        assert COVARIANCE[arm, own(f"forearm_girth_{side}")] == pytest.approx(0.6)


@pytest.mark.parametrize("name", ["trunk_length", "belly_depth", "head_size"])
def test_a_parameter_of_its_own_is_pulled_as_by_students_t(name):
    """The oracle is the density of Student's t: its logarithm's slope, for a parameter that correlates with none."""
    place, step = own(name), 1e-6
    assert np.count_nonzero(np.abs(COVARIANCE[place]) > 1e-12) == 1
    for away in (0.1, 1.0, 3.0, 8.0):
        shape = shape_at(ADULT.mean + away * (np.arange(SIZE) == place))
        pull = ADULT.equations(shape)[1]
        slope = (student.logpdf(away + step, TAILS) - student.logpdf(away - step, TAILS)) / (2.0 * step)
        assert pull[place] == pytest.approx(-slope, rel=1e-6)
        np.testing.assert_allclose(np.delete(pull, place), 0.0, atol=1e-9)


def test_the_farther_a_segment_is_from_others_the_less_the_prior_weighs():
    place = own("thigh_length_left")
    aways = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0])
    weights = (
        np.array(
            [
                ADULT.equations(shape_at(ADULT.mean + away * (np.arange(SIZE) == place)))[0][place, place]
                for away in aways
            ]
        )
        / ADULT.prior[place, place]
    )
    assert (np.diff(weights) < 0.0).all()
    assert weights[0] == pytest.approx((TAILS + 1.0) / TAILS)
    assert weights[2] == pytest.approx(1.0)  # at one deviation as a normal distribution
    assert weights[-1] < 0.1


def test_a_statistical_component_is_pulled_as_by_a_spring_however_far():
    for away in (0.5, 5.0):
        vector = ADULT.mean + away * (np.arange(SIZE) == 1)
        assert ADULT.equations(shape_at(vector))[1][1] == pytest.approx(away * ADULT.prior[1, 1])


def test_two_halves_of_what_was_seen_are_the_whole():
    one, other = some_information(1), some_information(2)
    met = ADULT.mean + 0.5 * np.sqrt(np.diag(COVARIANCE))
    shape = shape_at(ADULT.mean)
    halves = ADULT.having_seen(shape, one, one @ met).having_seen(shape, other, other @ met)
    whole = ADULT.having_seen(shape, one + other, (one + other) @ met)
    at = shape_at(ADULT.mean + 0.1 * np.sqrt(np.diag(COVARIANCE)))
    for first, second in zip(halves.equations(at), whole.equations(at), strict=True):
        np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-9 * np.abs(second).max())
    np.testing.assert_allclose(halves.information, whole.information, rtol=1e-9, atol=1e-9 * whole.information.max())
    assert halves.shape is shape
    np.testing.assert_array_equal(halves.prior, ADULT.prior)  # and is kept apart from it


def test_what_was_seen_does_not_pull_where_it_is_met():
    information, met = some_information(3), ADULT.mean + 0.7 * np.sqrt(np.diag(COVARIANCE))
    seen = ADULT.having_seen(ADULT.shape, information, information @ met)
    with_it, without = seen.equations(shape_at(met)), ADULT.equations(shape_at(met))
    np.testing.assert_allclose(with_it[1], without[1], atol=1e-9 * np.abs(information @ met).max())
    np.testing.assert_allclose(with_it[0] - without[0], information, atol=1e-9 * np.abs(without[0]).max())


def test_the_belief_in_what_people_have_in_common_is_the_marginal():
    """The oracle is the block of the dense covariance."""
    seen = ADULT.having_seen(
        shape_at(ADULT.mean + 0.3 * np.sqrt(np.diag(COVARIANCE))), some_information(4, SIZE), np.zeros(SIZE)
    )
    common = seen.common(asset())
    kept = [*range(COMMON), *range(SHAPES, SHAPES + len(CLOTHES))]
    assert common.free == FreeShape(COMMON, len(CLOTHES))
    block = np.linalg.inv(seen.information)[np.ix_(kept, kept)]
    np.testing.assert_allclose(np.linalg.inv(common.information), block, rtol=1e-8, atol=1e-10 * block.max())
    np.testing.assert_array_equal(common.vector(common.shape), seen.vector(seen.shape)[kept])
    assert not common.equations(seen.shape)[1].any()  # it is a prior about the most likely shape
    assert not common.soft.any()
    # what was learnt of the other parameters makes these no more certain than they are with them
    conditional = np.linalg.inv(seen.information[np.ix_(kept, kept)])
    assert (np.diag(block) >= np.diag(conditional) * (1.0 - 1e-9)).all()


def test_a_shape_moves_by_what_is_free_and_clothes_stay_between_nothing_and_the_thickest():
    few = replace(ADULT, free=FreeShape(3, len(CLOTHES) + 1))
    start = FittedShape(np.ones(SHAPES), even_clothes(0.01))
    for change_m, thick_m in ((0.005, 0.015), (-0.5, 0.0), (0.5, THICKEST_M)):
        moved = few.moved(start, np.append(np.full(3, 0.5), np.full(len(CLOTHES) + 1, change_m)))
        assert moved.coefficients.tolist() == [1.5] * 3 + [1.0] * (SHAPES - 3)
        np.testing.assert_allclose(moved.offset_m[: len(CLOTHES)], thick_m)
        assert moved.offset_m[len(CLOTHES)] == pytest.approx(change_m)  # a patch may lie deeper than the skin
        assert not moved.offset_m[len(CLOTHES) + 1 :].any()
    assert start.coefficients.tolist() == [1.0] * SHAPES


@pytest.mark.thorough
@pytest.mark.parametrize("height_m", [1.5, 1.72, 1.9])
def test_an_adult_of_a_measured_height_has_it_to_a_centimetre(height_m):
    known = adult_belief(asset()).standing(asset(), height_m, 0.01)
    assert standing_height(asset(), known.shape)[0] == pytest.approx(height_m, abs=0.002)
    assert spread_m(known) == pytest.approx(0.01, rel=0.02)
    assert spread_m(ADULT) > 0.05


def test_a_height_says_nothing_of_clothes_and_little_of_what_leaves_it_alone():
    known = adult_belief(asset()).standing(asset(), 1.9, 0.01)
    np.testing.assert_allclose(known.shape.offset_m, ADULT.shape.offset_m, atol=1e-12)
    gained = np.linalg.eigvalsh(known.seen)
    np.testing.assert_allclose(gained[:-1], 0.0, atol=1e-6 * gained[-1])  # one number says one thing
    assert gained[-1] > 0.0


def test_a_height_that_is_met_moves_nothing():
    own_m = standing_height(asset(), ADULT.shape)[0]
    np.testing.assert_allclose(adult_belief(asset()).standing(asset(), own_m, 0.01).shape.coefficients, 0.0, atol=1e-9)


@pytest.mark.parametrize("height_m", [1.2, 2.2])
def test_no_height_makes_a_body_that_no_adult_has(height_m):
    known = adult_belief(asset()).standing(asset(), height_m, 0.01)
    assert known.deviations(known.shape)[:SHAPES].max() < MOST_DEVIATIONS  # otherwise no first pose is believed


def test_the_heights_derivative_is_its_slope():
    shape = FittedShape(np.linspace(-0.5, 0.5, SHAPES), even_clothes(0.006))
    own_m, row = standing_height(asset(), shape)
    for k in range(SHAPES):
        moved = replace(shape, coefficients=shape.coefficients + 1e-6 * (np.arange(SHAPES) == k))
        assert (standing_height(asset(), moved)[0] - own_m) / 1e-6 == pytest.approx(row[k], abs=1e-6)


@pytest.mark.thorough
def test_bone_lengths_and_their_sigma_are_those_of_many_drawn_bodies():
    """Beside what no number of frames shows: ``SYSTEMATIC_M``."""
    rng = np.random.default_rng(5)
    square = rng.normal(size=(SIZE, SIZE))
    information = square @ square.T + 200.0 * np.eye(SIZE)
    shape = FittedShape(rng.normal(0.0, 0.5, SHAPES), even_clothes(0.005))
    belief = replace(ADULT, shape=shape, prior=information, soft=np.zeros(SIZE, bool))
    found = bone_lengths(asset(), belief)
    np.testing.assert_allclose([bone.length_m for bone in found], lengths_m(shape), atol=1e-12)
    drawn = rng.multivariate_normal(np.append(shape.coefficients, np.zeros(OFFSETS)), np.linalg.inv(information), 600)
    spread = np.std([lengths_m(shape_at(vector)) for vector in drawn], axis=0)
    of_shape = [np.sqrt(bone.sigma_m**2 - SYSTEMATIC_M[bone.bone.rsplit("_", 1)[0]] ** 2) for bone in found]
    np.testing.assert_allclose(of_shape, spread, rtol=0.1)  # 600 draws: 2.9 % each


def two_others(seen: ShapeBelief) -> tuple[list[FittedShape], np.ndarray]:
    """Shapes about one standard deviation of the prior away, and their directions."""
    away = np.random.default_rng(5).normal(size=(2, SIZE)) * np.sqrt(np.diag(COVARIANCE))
    return [shape_at(seen.vector(seen.shape) + one) for one in away], away


def test_a_belief_that_includes_other_shapes_has_the_spread_of_the_mixture_and_the_same_shape():
    at = shape_at(ADULT.mean + 0.3 * np.sqrt(np.diag(COVARIANCE)))
    seen = ADULT.having_seen(at, some_information(6, SIZE), np.zeros(SIZE))
    others, away = two_others(seen)
    wide = seen.including(others, np.array([0.2, 0.1]))
    assert wide.shape is seen.shape
    added = 0.2 * np.outer(away[0], away[0]) + 0.1 * np.outer(away[1], away[1])
    mixture = np.linalg.inv(seen.information) + added
    np.testing.assert_allclose(np.linalg.inv(wide.information), mixture, atol=1e-7 * np.abs(mixture).max())
    gradient = wide.equations(wide.shape)[1]
    np.testing.assert_allclose(gradient, 0.0, atol=1e-7 * np.abs(wide.seen @ wide.vector(wide.shape)).max())
    impossible = seen.including(others, np.zeros(2))
    np.testing.assert_allclose(impossible.information, seen.information, rtol=1e-6, atol=1e-6 * seen.information.max())
