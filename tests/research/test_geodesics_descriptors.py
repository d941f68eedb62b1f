"""Full and anchor descriptors and GMDS: the paper's bound, invariance, isometry, brute force as oracle, refusals."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from surface_builder import flat_grid, grid_surface

from anchorpose.errors import DegenerateGeometry
from anchorpose.geodesics.anchors import Anchors
from anchorpose.geodesics.descriptor import anchor_descriptor
from anchorpose.research.full_descriptor import full_descriptor
from anchorpose.research.geodesic_solvers import Solver, solve_distance
from anchorpose.research.gmds_exact import descriptor_cost, distortion, match_by_descriptors, match_by_distortion
from anchorpose.surface.mesh import keep_nodes
from anchorpose.surface.surface import Surface

SPACING = 0.02


def sheet(rows=7, cols=9) -> Surface:
    return flat_grid(rows, cols, SPACING)


def bent(turn_rad: float, rows=7, cols=9) -> Surface:
    """The same sheet folded along every column by one angle: each cell stays flat and keeps its sides."""
    heading = turn_rad * np.arange(cols - 1)
    x = np.concatenate([[0.0], np.cumsum(np.sin(heading))]) * SPACING
    z = np.concatenate([[0.0], np.cumsum(np.cos(heading))]) * SPACING
    points = np.empty((rows, cols, 3))
    points[..., 0], points[..., 2] = x, -z
    points[..., 1] = -np.arange(rows)[:, None] * SPACING
    return grid_surface(points)


def hill(height_m: float, rows=7, cols=9) -> Surface:
    """A sheet of its own shape, no two nodes alike."""
    row, col = np.mgrid[:rows, :cols] * SPACING
    away = ((row - 0.05) ** 2 + (col - 0.11) ** 2) / 0.05**2
    return grid_surface(np.stack([height_m * np.exp(-away), -row, -col * 1.1 - 0.2 * row], axis=2))


def moved(surface: Surface) -> Surface:
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    return replace(surface, points_m=(surface.points_m @ turn.T + [0.3, -0.2, 1.0]).astype(np.float32))


def corners(surface: Surface) -> Anchors:
    """Four anchors at the corners, the fifth missed."""
    corner = [int(np.argmin(surface.pixel @ np.array(way))) for way in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    node = np.array([*corner, -1], np.int32)
    found = node >= 0
    position_m = np.where(found[:, None], surface.points_m[node], np.nan)
    return Anchors(node=node, position_m=position_m, sigma_m=np.where(found, 0.005, np.nan))


def some_distances(seed: int, count: int) -> np.ndarray:
    """Distances between random places, which have nothing to do with one another."""
    places = np.random.default_rng(seed).normal(size=(count, 3))
    return np.linalg.norm(places[:, None] - places[None], axis=2)


@pytest.mark.parametrize("solver", list(Solver))
@pytest.mark.parametrize("change", [moved, lambda surface: bent(0.35), lambda surface: bent(-0.2)])
def test_descriptors_do_not_change_under_rigid_motion_and_isometry(change, solver):
    before, after = sheet(), change(sheet())
    slack = 1e-6 if solver is not Solver.HEAT else SPACING / 3  # of equal diagonals heat may take the other one
    np.testing.assert_allclose(full_descriptor(after, solver), full_descriptor(before, solver), atol=slack)
    one, other = (
        anchor_descriptor(surface, corners(surface), partial(solve_distance, solver=solver))
        for surface in (before, after)
    )
    np.testing.assert_allclose(one, other, atol=slack)
    assert np.isnan(one[:, 4]).all()


def test_a_hill_is_no_isometry_of_a_sheet():
    assert np.abs(full_descriptor(hill(0.04)) - full_descriptor(hill(0.0))).max() > 0.01


def test_the_full_descriptor_on_a_sheet_is_the_straight_line_to_every_node():
    surface = sheet()
    straight = np.linalg.norm(surface.points_m[:, None] - surface.points_m[None], axis=2)
    np.testing.assert_allclose(full_descriptor(surface), straight, atol=1e-6)


def test_the_full_descriptor_is_refused_where_there_is_a_hole_or_a_second_piece():
    surface = sheet(9, 9)
    with pytest.raises(DegenerateGeometry, match="1 holes"):
        full_descriptor(keep_nodes(surface, (surface.pixel != [4, 4]).any(axis=1)))
    with pytest.raises(DegenerateGeometry, match="2 pieces"):
        full_descriptor(keep_nodes(surface, surface.pixel[:, 1] != 4))
    with pytest.raises(DegenerateGeometry, match="no single sheet"):
        full_descriptor(keep_nodes(surface, np.zeros(len(surface), bool)))


@given(st.integers(2, 12), st.integers(1, 12), st.integers(0, 10_000))
def test_the_cost_of_a_map_lies_between_the_paper_s_bound_and_twice_its_distortion(count_a, count_b, seed):
    a, b = some_distances(seed, count_a), some_distances(seed + 1, count_b)
    match = np.random.default_rng(seed).integers(0, count_b, count_a)
    worst, cost = distortion(a, b, match), descriptor_cost(a, b, match)
    assert 2 * worst - 1e-9 <= cost <= count_a * np.sqrt(count_a - 1) * worst + 1e-9
    assert cost <= count_a * np.sqrt(count_a) * worst  # as the paper has it


@settings(max_examples=40)
@given(st.integers(2, 5), st.integers(1, 5), st.integers(0, 10_000))
def test_branch_and_bound_finds_what_trying_all_maps_finds(count_a, count_b, seed):
    a, b = some_distances(seed, count_a), some_distances(seed + 1, count_b)
    for search, cost in ((match_by_distortion, distortion), (match_by_descriptors, descriptor_cost)):
        found = search(a, b)
        least = min(cost(a, b, np.array(match)) for match in product(range(count_b), repeat=count_a))
        assert found.proven
        assert found.cost == pytest.approx(least, abs=1e-9)
        assert cost(a, b, found.match) == found.cost


def test_when_it_must_stop_early_it_says_how_much_better_a_map_could_be():
    a, b = some_distances(3, 5), some_distances(4, 5)
    for search in (match_by_distortion, match_by_descriptors):
        hurried, patient = search(a, b, max_steps=2), search(a, b)
        assert hurried.steps == 2
        assert not hurried.proven
        assert hurried.lower_bound <= patient.cost <= hurried.cost
        assert hurried.lower_bound > 0


@pytest.mark.parametrize("search", [match_by_distortion, match_by_descriptors])
def test_a_mesh_finds_itself_again_when_it_was_moved_shuffled_and_only_its_part_is_seen(search):
    whole = full_descriptor(hill(0.04), Solver.EXACT)
    order = np.random.default_rng(5).permutation(len(whole))
    part = np.sort(np.random.default_rng(6).choice(len(whole), 30, replace=False))
    for source in (np.arange(len(whole)), part):
        found = search(whole[np.ix_(source, source)], whole[np.ix_(order, order)])
        assert found.proven
        assert found.cost < 1e-5 * len(whole)
        np.testing.assert_array_equal(order[found.match], source)


def test_gmds_tells_a_bent_sheet_from_a_hill():
    flat, other = hill(0.0), hill(0.05)
    coarse = np.flatnonzero((flat.pixel % 3 == 0).all(axis=1))
    small, large = (full_descriptor(surface)[np.ix_(coarse, coarse)] for surface in (flat, other))
    same, different = match_by_distortion(small, small), match_by_distortion(small, large)
    assert same.d_pe_m < 1e-6
    assert different.lower_bound > 0.005
    assert different.d_pe_m == different.cost / 2


def test_the_two_criteria_may_choose_different_maps():
    """So "essentially equivalent" holds for isometries, not for what is best otherwise."""
    for seed in range(50):
        a, b = some_distances(seed, 4), some_distances(seed + 100, 4)
        by_worst, by_all = match_by_distortion(a, b), match_by_descriptors(a, b)
        if distortion(a, b, by_all.match) > 1.05 * by_worst.cost:
            assert descriptor_cost(a, b, by_worst.match) > by_all.cost
            return
    pytest.fail("in fifty trials both criteria chose maps of the same distortion")


def test_what_is_no_matrix_of_distances_or_no_map_is_refused():
    a = some_distances(0, 4)
    broken = {
        "square": a[:3],
        "finite": np.where(a > 1, np.inf, a),
        "both ways": np.triu(a),
    }
    for reason, matrix in broken.items():
        with pytest.raises(ValueError, match=reason):
            match_by_distortion(matrix, a)
    for match in ([0, 1, 2], [0, 1, 2, 4], [0, 1, 2, -1]):
        with pytest.raises(ValueError, match="no map"):
            distortion(a, a, np.array(match))
    with pytest.raises(ValueError, match="does not exist"):
        match_by_distortion(a, np.zeros((0, 0)))
