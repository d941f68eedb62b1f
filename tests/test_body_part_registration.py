"""Parts on their own, as the paper registers them: Arun's fit, ICP, and what happens where too little is seen."""

from __future__ import annotations

import numpy as np
import pytest
from body_builder import adult_rest, asset, points, random_pose
from scipy.spatial.transform import Rotation

from anchorpose.body.part_registration import (
    PartRegistrationConfig,
    fit_rigid_transform,
    joints_of_parts,
    register_parts,
)
from anchorpose.body.skin_points import pose_points
from anchorpose.camera import transform_points
from anchorpose.errors import DegenerateGeometry

IDENTITY = np.tile(np.eye(4), (3, 1, 1))


def rigid(turn_deg: tuple[float, float, float], shift_m: tuple[float, float, float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix()
    T[:3, 3] = shift_m
    return T


def a_limb(seed: int, count: int = 200) -> np.ndarray:
    """Nodes on an oval cylinder that tapers: no motion but the right one maps it onto itself."""
    rng = np.random.default_rng(seed)
    around, along = rng.uniform(0.0, np.pi, count), rng.uniform(0.0, 0.35, count)
    radius = 0.06 - 0.07 * along
    return np.column_stack([radius * np.sin(around), along, 0.6 * radius * np.cos(around)])


def test_a_known_motion_is_found_exactly():
    source = np.random.default_rng(1).normal(size=(20, 3))
    T = rigid((20.0, -70.0, 130.0), (0.3, -1.0, 2.0))
    np.testing.assert_allclose(fit_rigid_transform(source, transform_points(T, source)), T, atol=1e-12)


def test_a_quarter_turn_of_a_square_is_a_quarter_turn():
    square = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    expected = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    np.testing.assert_allclose(fit_rigid_transform(square, np.roll(square, -1, axis=0)), expected, atol=1e-12)


def test_the_order_of_the_pairs_does_not_matter():
    rng = np.random.default_rng(2)
    source, target = rng.normal(size=(2, 15, 3))
    order = rng.permutation(15)
    np.testing.assert_allclose(
        fit_rigid_transform(source[order], target[order]), fit_rigid_transform(source, target), atol=1e-12
    )


def test_noise_leaves_the_least_squares_motion():
    rng = np.random.default_rng(3)
    source = rng.normal(size=(40, 3))
    target = transform_points(rigid((5.0, 10.0, -8.0), (0.1, 0.0, 0.2)), source) + rng.normal(0.0, 0.02, (40, 3))
    T = fit_rigid_transform(source, target)
    best = ((transform_points(T, source) - target) ** 2).sum()
    for turn in np.vstack([np.eye(3), -np.eye(3)]):
        beside = rigid(tuple(0.05 * turn), tuple(0.001 * turn)) @ T
        assert ((transform_points(beside, source) - target) ** 2).sum() > best


@pytest.mark.parametrize("seed", range(4))
def test_a_mirrored_body_is_never_answered_with_a_reflection(seed):
    body = np.random.default_rng(seed).normal(size=(12, 3))
    for target in (body * [-1.0, 1.0, 1.0], np.random.default_rng(seed + 50).normal(size=(12, 3))):
        T = fit_rigid_transform(body, target)
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def test_points_on_a_line_are_refused():
    line = np.outer(np.linspace(0.0, 1.0, 9), [1.0, 2.0, -1.0])
    with pytest.raises(DegenerateGeometry, match="collinear"):
        fit_rigid_transform(line, line)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_points_are_refused(count):
    with pytest.raises(DegenerateGeometry, match=f"{count} points"):
        fit_rigid_transform(np.eye(3)[:count], np.eye(3)[:count])


def test_pairs_that_are_a_few_centimetres_off_are_refined_on_the_surface():
    T = rigid((4.0, 12.0, -6.0), (0.02, 0.01, -0.03))
    nodes = a_limb(1, 400)
    surface = transform_points(T, nodes)
    pairs = surface + np.random.default_rng(2).normal(0.0, 0.02, surface.shape)  # the descriptor's own error
    part = np.ones(len(nodes), dtype=int)
    rough = fit_rigid_transform(nodes, pairs)
    found = register_parts(nodes, part, pairs, surface, IDENTITY, PartRegistrationConfig(iterations=20))
    np.testing.assert_array_equal(found.registered, [False, True, False])

    def off(T_found: np.ndarray) -> float:
        return float(np.linalg.norm(transform_points(T_found, nodes) - surface, axis=1).mean())

    assert off(found.T_next_now[1]) < 0.5 * off(rough)
    assert off(found.T_next_now[1]) < 0.001


def test_parts_move_each_on_its_own():
    motions = [rigid((0.0, 0.0, 10.0), (0.02, 0.0, 0.0)), rigid((5.0, 0.0, 0.0), (0.0, 0.0, 0.03))]
    limbs = [a_limb(3), np.add(a_limb(4), [0.0, 0.0, 0.6])]
    moved = [transform_points(T, limb) for T, limb in zip(motions, limbs, strict=True)]
    nodes, matched = np.concatenate(limbs), np.concatenate(moved)
    part = np.repeat([0, 2], len(limbs[0]))
    found = register_parts(nodes, part, matched, matched, IDENTITY, PartRegistrationConfig())
    np.testing.assert_array_equal(found.registered, [True, False, True])
    np.testing.assert_allclose(found.T_next_now[[0, 2]], motions, atol=1e-6)


def predicted_motions() -> np.ndarray:
    return np.stack([rigid((0.0, 3.0, 0.0), (0.01, 0.0, 0.0))] * 3)


@pytest.mark.parametrize("pairs", [0, 5, 11])
def test_a_part_with_too_few_pairs_keeps_its_prediction_and_says_so(pairs):
    nodes, predicted = a_limb(5), predicted_motions()
    matched = np.full_like(nodes, np.nan)
    matched[:pairs] = transform_points(rigid((0.0, 0.0, 0.0), (0.03, 0.0, 0.0)), nodes[:pairs])
    found = register_parts(nodes, np.ones(len(nodes), int), matched, nodes, predicted, PartRegistrationConfig())
    assert not found.registered.any()
    np.testing.assert_array_equal(found.T_next_now, predicted)


def test_pairs_far_from_the_prediction_are_not_believed():
    nodes, predicted = a_limb(6), predicted_motions()
    matched = np.add(nodes, [0.0, 0.0, 0.5])
    found = register_parts(nodes, np.ones(len(nodes), int), matched, matched, predicted, PartRegistrationConfig())
    assert not found.registered.any()
    np.testing.assert_array_equal(found.T_next_now, predicted)


def test_a_part_whose_pairs_lie_on_a_line_keeps_its_prediction_and_says_so():
    nodes = np.outer(np.linspace(0.0, 0.3, 40), [0.0, 1.0, 0.0])
    predicted = predicted_motions()
    found = register_parts(nodes, np.ones(40, int), nodes, nodes, predicted, PartRegistrationConfig())
    assert not found.registered.any()
    np.testing.assert_array_equal(found.T_next_now, predicted)


def test_the_predicted_motions_are_not_changed_in_place():
    nodes, predicted = a_limb(7), predicted_motions()
    register_parts(nodes, np.ones(len(nodes), int), nodes, nodes, predicted, PartRegistrationConfig())
    np.testing.assert_array_equal(predicted, predicted_motions())


def test_parts_that_stay_joined_have_the_joints_of_the_body():
    rest = adult_rest()
    transforms = pose_points(points(), rest, random_pose(3)).transforms
    joints = rest.body.joints(transforms)
    found = joints_of_parts(asset(), rest.body, transforms)
    np.testing.assert_allclose(found, joints, atol=1e-9)


@pytest.mark.parametrize("wrong", [{"least_pairs": 2}, {"iterations": -1}, {"reach_m": 0.0}, {"reach_m": float("nan")}])
def test_a_configuration_that_cannot_work_is_refused(wrong):
    with pytest.raises(ValueError, match="least_pairs"):
        PartRegistrationConfig(**wrong)
