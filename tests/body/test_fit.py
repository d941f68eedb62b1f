"""The normal equations of a frame, the priors in them, and the joint step on shape and poses."""

import numpy as np
import pytest
from body_builder import adult, adult_body, asset, hide_bones, points, random_pose, seen_body, shaken, standing

from anchorpose.body import fit
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import surface_constraints
from anchorpose.body.evidence import evidence_rows
from anchorpose.body.fit import (
    HINGE_LIMIT_SIGMA,
    MAX_TURN,
    NormalEquations,
    hidden_bones,
    limited,
    pose_equations,
    prior_equations,
    range_information,
    solve_damped,
)
from anchorpose.body.joint_ranges import hinge_axes, joint_range
from anchorpose.body.learning import LARGEST_STEP, ShapeFrame, learn_shape_step
from anchorpose.body.pose import DEGREE, MOVING_BONES, POSE_SIZE, Pose
from anchorpose.body.shape_prior import ShapeBelief
from anchorpose.body.shape_rows import FreeShape
from anchorpose.body.skin_points import FittedShape, build_body, even_clothes, pose_points


@pytest.fixture
def girdle_at_rest(monkeypatch):
    """The shoulder girdle's mean follows the arm from step to step; within a step, as in these laws, it stays."""
    monkeypatch.setattr(fit, "joint_range_at", lambda own, pose, hidden=None: joint_range(own, hidden))


BODY = adult_body()
ROWS = RegistrationConfig().rows_per_observation
STEP = 1e-5


def equations_at(pose: Pose, constraints, free: FreeShape | None = None) -> NormalEquations:
    posed = pose_points(BODY, pose)
    prior = prior_equations(points(), pose, None, hidden_bones(points(), constraints, ROWS))
    return pose_equations(BODY, pose, posed, constraints, prior, ROWS, free)


def slope(cost, pose: Pose) -> np.ndarray:
    moving = points().moving
    return np.array(
        [(cost(pose.moved(d, moving)) - cost(pose.moved(-d, moving))) / (2.0 * STEP) for d in STEP * np.eye(POSE_SIZE)]
    )


@pytest.mark.usefixtures("girdle_at_rest")
@pytest.mark.parametrize("seed", [1, 2])
def test_the_gradient_is_half_the_slope_of_the_cost(seed):
    truth = random_pose(seed)
    pose = shaken(truth, seed + 5, 3.0, 0.02)
    rows = evidence_rows(BODY, pose, seen_body(truth, BODY), 0.1, RegistrationConfig(node_count=400))
    numeric = slope(lambda p: equations_at(p, rows).cost, pose)
    gradient = equations_at(pose, rows).gradient
    np.testing.assert_allclose(gradient, numeric / 2.0, atol=1e-4 * np.abs(gradient).max())


@pytest.mark.usefixtures("girdle_at_rest")
@pytest.mark.parametrize("bend_deg", [-25.0, 5.0, 60.0])
def test_the_priors_gradient_is_half_the_slope_of_its_cost_on_both_sides_of_the_limit(bend_deg):
    axes, _ = hinge_axes(points().asset, "LeftLeg")
    pose = standing(LeftLeg=tuple(bend_deg * axes[0]), RightArm=(50.0, 20.0, -30.0), Spine=(5.0, -9.0, 3.0))
    numeric = slope(lambda p: prior_equations(points(), p, None).cost, pose)
    gradient = prior_equations(points(), pose, None).gradient
    np.testing.assert_allclose(gradient, numeric / 2.0, atol=1e-5 * np.abs(gradient).max())


@pytest.mark.usefixtures("girdle_at_rest")
def test_the_priors_hessian_is_that_of_its_deviations_multiplied_out():
    pose, ranges, step = standing(LeftLeg=(0.0, 0.0, 20.0), RightArm=(50.0, 20.0, -30.0)), joint_range(asset()), 1e-6

    def deviations(change: np.ndarray) -> np.ndarray:
        vectors = pose.moved(change, points().moving).rotation_vectors(points().moving)
        past = np.maximum(ranges.hinge_limit - (vectors * ranges.hinge).sum(axis=1), 0.0) / HINGE_LIMIT_SIGMA
        free = ranges.information[1:, :, 1:].reshape(POSE_SIZE - 6, POSE_SIZE - 6)
        return np.append(np.linalg.cholesky(free).T @ (vectors - ranges.mean)[1:].ravel(), past)

    slope = np.stack([(deviations(d) - deviations(-d)) / (2.0 * step) for d in step * np.eye(POSE_SIZE)], axis=1)
    prior = prior_equations(points(), pose, None)
    hessian, gradient, cost = prior.hessian, prior.gradient, prior.cost
    np.testing.assert_allclose(hessian, slope.T @ slope, atol=1e-5 * hessian.max())
    np.testing.assert_allclose(gradient, slope.T @ deviations(np.zeros(POSE_SIZE)), atol=1e-5 * np.abs(gradient).max())
    assert cost == pytest.approx((deviations(np.zeros(POSE_SIZE)) ** 2).sum())


def test_a_knee_past_straight_is_driven_back_and_a_bent_one_is_not():
    axes, _ = hinge_axes(points().asset, "LeftLeg")
    row = MOVING_BONES.index("LeftLeg")
    pull = [
        float(
            -prior_equations(points(), standing(LeftLeg=tuple(bend * axes[0])), None).gradient[3 * row : 3 * row + 3]
            @ axes[0]
        )
        for bend in (-20.0, 15.0)
    ]
    assert pull[0] > 10.0 * abs(pull[1])


@pytest.mark.usefixtures("girdle_at_rest")
def test_at_the_mean_of_the_joint_range_the_prior_is_at_rest():
    ranges = joint_range(points().asset)
    pose = standing().moved(np.append(ranges.mean.ravel(), np.zeros(3)), points().moving)
    prior = prior_equations(points(), pose, None)
    gradient, cost = prior.gradient, prior.cost
    np.testing.assert_allclose(gradient, 0.0, atol=1e-9)
    assert cost == pytest.approx(0.0, abs=1e-12)


def test_the_joint_range_says_nothing_about_where_the_patient_stands_and_faces():
    information = range_information(points(), random_pose(3), ())
    free = [*range(3), *range(POSE_SIZE - 3, POSE_SIZE)]
    assert not information[free].any()
    assert np.linalg.eigvalsh(information[3:-3, 3:-3]).min() > 0.0


def test_only_parts_that_rows_hardly_show_are_hidden():
    body, seen = BODY, seen_body(standing(), BODY, change=hide_bones("LeftLeg", "LeftFoot", "LeftToeBase"))
    rows = surface_constraints(pose_points(body, standing()), seen.surface, seen.cameras, 0.06, RegistrationConfig())
    assert {MOVING_BONES[row] for row in hidden_bones(points(), rows, ROWS)} == {"LeftLeg", "LeftFoot"}


def test_a_seen_limb_has_the_textbooks_range_and_a_hidden_one_what_the_seen_ones_tell():
    """The most probable hidden leg beside a seated one sits; the seated one itself is not pulled anywhere by it."""
    hidden = tuple(MOVING_BONES.index(f"Left{bone}") for bone in ("UpLeg", "Leg", "Foot"))
    seated = standing(RightUpLeg=(0.0, 0.0, 70.0), RightLeg=(0.0, 0.0, -80.0))
    pose = seated
    for _ in range(20):
        prior = prior_equations(points(), pose, None, hidden)
        rows = [3 * bone + axis for bone in hidden for axis in range(3)]
        change = np.zeros(POSE_SIZE)
        change[rows] = -np.linalg.solve(prior.hessian[np.ix_(rows, rows)], prior.gradient[rows])
        pose = pose.moved(change, points().moving)
    knee = pose.rotation_vectors(points().moving)[MOVING_BONES.index("LeftLeg")]
    assert np.linalg.norm(knee) > 30.0 * DEGREE
    right = slice(3 * MOVING_BONES.index("RightUpLeg"), 3 * MOVING_BONES.index("RightLeg") + 3)
    alone = prior_equations(points(), seated, None, ()).gradient[right]
    np.testing.assert_allclose(prior_equations(points(), pose, None, hidden).gradient[right], alone, atol=1e-6)


def test_a_prediction_that_is_met_changes_only_the_certainty():
    pose, information = random_pose(4), np.diag(np.linspace(1.0, 9.0, POSE_SIZE))
    alone = prior_equations(points(), pose, None)
    with_it = prior_equations(points(), pose, (pose, information))
    np.testing.assert_allclose(with_it.hessian - alone.hessian, information, atol=1e-9)
    np.testing.assert_allclose(with_it.gradient, alone.gradient, atol=1e-9)


def test_a_strong_prediction_is_obeyed():
    pose, predicted = random_pose(5), shaken(random_pose(5), 6, 3.0, 0.03)
    information = np.eye(POSE_SIZE) * 1e8
    for _ in range(4):
        prior = prior_equations(points(), pose, (predicted, information))
        pose = pose.moved(-np.linalg.solve(prior.hessian, prior.gradient), points().moving)
    np.testing.assert_allclose(pose.rotations, predicted.rotations, atol=1e-4)
    np.testing.assert_allclose(pose.root_m, predicted.root_m, atol=1e-6)


def test_shape_columns_leave_the_equations_of_the_pose_as_they_are():
    pose = random_pose(6)
    rows = evidence_rows(BODY, pose, seen_body(pose, BODY), 0.1, RegistrationConfig(node_count=400))
    plain, shaped = equations_at(pose, rows), equations_at(pose, rows, FreeShape(5, 3))
    assert shaped.hessian.shape == (POSE_SIZE + 8, POSE_SIZE + 8)
    np.testing.assert_allclose(shaped.hessian[:POSE_SIZE, :POSE_SIZE], plain.hessian, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(shaped.gradient[:POSE_SIZE], plain.gradient, rtol=1e-9, atol=1e-6)
    assert shaped.cost == pytest.approx(plain.cost)


def test_the_damped_step_solves_the_equations_but_for_a_thousandth():
    rng = np.random.default_rng(7)
    factor = rng.normal(size=(POSE_SIZE, POSE_SIZE))
    hessian, step = factor @ factor.T + 50.0 * np.eye(POSE_SIZE), rng.normal(size=POSE_SIZE)
    found = solve_damped(NormalEquations(hessian, -hessian @ step, 0.0))
    np.testing.assert_allclose(found, step, atol=0.02)
    assert np.abs(found - step).max() > 1e-6


def test_what_nothing_was_observed_of_stays_as_it_is():
    hessian, gradient = np.zeros((POSE_SIZE, POSE_SIZE)), np.zeros(POSE_SIZE)
    hessian[:3, :3], gradient[:3] = 2.0 * np.eye(3), -1.0
    found = solve_damped(NormalEquations(hessian, gradient, 0.0))
    np.testing.assert_allclose(found[:3], 0.5, rtol=2e-3)
    assert not found[3:].any()


def test_a_step_is_shortened_to_the_largest_turn_and_not_lengthened():
    change = np.zeros(POSE_SIZE)
    change[4], change[-1] = 120.0 * DEGREE, 0.4
    short = limited(change)
    assert short[4] == pytest.approx(MAX_TURN)
    assert short[-1] == pytest.approx(0.1)
    np.testing.assert_array_equal(limited(short / 10.0), short / 10.0)
    shift = np.append(np.zeros(POSE_SIZE - 3), [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(limited(shift), shift)


FREE = FreeShape(4, 3)
SIZE = sum(FREE)


def some_belief(away: float = 0.2) -> ShapeBelief:
    """A prior and something seen, both of no particular shape; ``away``: how far the two are from the shape's zero."""
    rng = np.random.default_rng(3)
    unit = np.array([1.0] * FREE.coefficients + [0.004] * FREE.offsets)

    def information() -> np.ndarray:
        square = rng.normal(size=(SIZE, SIZE))
        return (square @ square.T + np.eye(SIZE)) / np.outer(unit, unit)

    prior, seen = information(), information()
    mean, met = away * unit, -away * unit
    shape = FittedShape(np.full(FREE.coefficients, 0.3), even_clothes(0.008))
    return ShapeBelief(shape, FREE, mean, prior, np.zeros(SIZE, bool), seen, seen @ met)


def frames_for(shape: FittedShape, poses: list[Pose], truths: list[Pose]) -> list[ShapeFrame]:
    body, config = build_body(points(), shape), RegistrationConfig(node_count=500)
    return [
        ShapeFrame(pose, evidence_rows(body, pose, seen_body(truth, BODY), 0.1, config), ROWS)
        for pose, truth in zip(poses, truths, strict=True)
    ]


def test_the_step_on_the_shape_is_the_step_of_the_whole_system():
    """The Schur complement against one dense solve over shape and all poses."""
    shape, known = FittedShape(adult().coefficients[:4], even_clothes(0.025)), some_belief()
    truths = [random_pose(seed) for seed in (8, 9)]
    poses = [shaken(truth, 3, 2.0, 0.01) for truth in truths]
    frames, body = frames_for(shape, poses, truths), build_body(points(), shape)
    at = np.append(shape.coefficients, shape.offset_m[: FREE.offsets])
    whole, right = np.zeros((2 * POSE_SIZE + SIZE,) * 2), np.zeros(2 * POSE_SIZE + SIZE)
    whole[-SIZE:, -SIZE:] = known.prior + known.seen
    right[-SIZE:] = known.prior @ (at - known.mean) + known.seen @ at - known.pull
    for number, frame in enumerate(frames):
        posed = pose_points(body, frame.pose)
        hidden = hidden_bones(points(), frame.constraints, ROWS)
        prior = prior_equations(points(), frame.pose, None, hidden)
        own = pose_equations(body, frame.pose, posed, frame.constraints, prior, ROWS, FREE)
        place = [*range(number * POSE_SIZE, (number + 1) * POSE_SIZE), *range(2 * POSE_SIZE, 2 * POSE_SIZE + SIZE)]
        damped = own.hessian + 1e-3 * np.diag(np.append(np.diag(own.hessian)[:POSE_SIZE], np.zeros(SIZE)))
        whole[np.ix_(place, place)] += damped
        right[place] += own.gradient
    change = -np.linalg.solve(whole, right)
    belief, moved = learn_shape_step(points(), shape, frames, known)
    found = belief.shape
    assert 0.05 < np.abs(change[-SIZE:-3]).max() < LARGEST_STEP
    np.testing.assert_allclose(found.coefficients - shape.coefficients, change[-SIZE:-3], atol=1e-7)
    np.testing.assert_allclose((found.offset_m - shape.offset_m)[:3], change[-3:], atol=1e-9)
    np.testing.assert_array_equal(found.offset_m[3:], shape.offset_m[3:])  # these were not free
    marginal = np.linalg.inv(np.linalg.inv(whole)[-SIZE:, -SIZE:])  # of the shape, whatever the poses are
    np.testing.assert_allclose(belief.information, marginal, rtol=1e-4, atol=1e-6 * np.abs(marginal).max())
    for number, pose in enumerate(poses):
        expected = pose.moved(limited(change[number * POSE_SIZE : (number + 1) * POSE_SIZE]), points().moving)
        np.testing.assert_allclose(moved[number].rotations, expected.rotations, atol=1e-7)
        np.testing.assert_allclose(moved[number].root_m, expected.root_m, atol=1e-7)


def test_what_was_seen_is_met_where_it_was_linearised():
    """The belief after a step has its least cost where the undamped step leads: nothing is lost between windows."""
    shape, known = FittedShape(adult().coefficients[:4], even_clothes(0.020)), some_belief()
    truth = random_pose(8)
    (frame,) = frames_for(shape, [shaken(truth, 3, 2.0, 0.01)], [truth])
    belief, _ = learn_shape_step(points(), shape, [frame], known)
    pull = belief.equations(belief.shape)[1]
    before = known.equations(shape)[1]
    unit = 1.0 / np.sqrt(np.diag(belief.information))
    assert np.abs(pull * unit).max() < 1e-6 * np.abs(before * unit).max()


def test_a_step_on_the_shape_is_shortened_to_the_largest():
    shape, known, truth = FittedShape(np.zeros(4), even_clothes(0.006)), some_belief(40.0), random_pose(8)
    (frame,) = frames_for(shape, [truth], [truth])
    found = learn_shape_step(points(), shape, [frame], known)[0].shape
    assert np.abs(found.coefficients).max() == pytest.approx(LARGEST_STEP)


def test_a_hip_bends_far_and_hardly_goes_back():
    """A seated thigh is usual, one as far behind the trunk is not: a hidden leg is not laid there."""

    def rarity(flexion_deg: float) -> float:
        return prior_equations(points(), standing(LeftUpLeg=(0.0, 0.0, flexion_deg)), None).cost

    assert rarity(90.0) < 10.0 < rarity(-40.0)
    assert rarity(-15.0) < 5.0  # a step
