"""Neighbourhoods along the surface, curvature and gradients, where the answers are known."""

from dataclasses import replace

import numpy as np
import pytest
from features_builder import height_field, lump, moved, renumbered, rough, somewhere
from scipy.sparse.csgraph import dijkstra
from surface_builder import flat_grid, with_links

from anchorpose.research.features.mesh_gradient import (
    gaussian_curvature,
    mean_curvature,
    mesh_gradient,
    principal_curvatures,
)
from anchorpose.research.features.rings import Rings, rings_within
from anchorpose.research.geodesic_solvers import edge_graph
from anchorpose.surface.surface import Surface

MIDDLE = 41 * 41 // 2


def as_table(rings: Rings, count: int) -> np.ndarray:
    """(k, n) distances, inf beyond."""
    table = np.full((len(rings.start) - 1, count), np.inf)
    row = np.repeat(np.arange(len(table)), np.diff(rings.start))
    assert len(set(zip(row.tolist(), rings.node.tolist(), strict=True))) == len(row), "a node is listed twice"
    table[row, rings.node] = rings.distance_m
    return table


@pytest.mark.thorough
def test_neighbours_and_their_distances_are_those_of_dijkstra_links_included() -> None:
    present = np.random.default_rng(1).random((20, 20)) > 0.3
    surface = flat_grid(20, 20, 0.02, present)
    surface = rough(with_links(surface, np.array([[0, len(surface) - 1], [3, 150]]), np.array([0.01, 0.05])), 2, 0.004)
    reach = np.random.default_rng(3).uniform(0.03, 0.2, len(surface))
    expected = dijkstra(edge_graph(surface), directed=False)
    close = expected <= reach[:, None]
    table = as_table(rings_within(surface, reach), len(surface))
    np.testing.assert_array_equal(np.isfinite(table), close)
    np.testing.assert_allclose(table[close], expected[close], rtol=1e-5, atol=1e-7)


def test_a_row_begins_with_its_own_node_and_is_empty_without_a_reach_or_a_position() -> None:
    surface = flat_grid(5, 5, 0.02)
    points = surface.points_m.copy()
    points[7] = np.nan
    reach = np.where(np.arange(25) == 13, np.nan, 0.05)
    rings = rings_within(replace(surface, points_m=points), reach)
    np.testing.assert_array_equal(np.flatnonzero(np.diff(rings.start) == 0), [7, 13])
    assert rings.node[rings.start[12]] == 12
    assert 7 not in rings.node


@pytest.mark.parametrize("reach", [0.0, -1.0])
def test_a_reach_of_nothing_is_refused(reach: float) -> None:
    with pytest.raises(ValueError, match="reach"):
        rings_within(flat_grid(3, 3, 0.02), reach)


def test_a_tilted_plane_has_no_curvature() -> None:
    surface = height_field(lambda left, up: 0.7 * left - 0.3 * up)
    np.testing.assert_allclose(principal_curvatures(surface, 0.05), 0.0, atol=2e-4)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_sphere_bends_by_its_radius_everywhere_and_outwards_is_positive(sign: float) -> None:
    surface = height_field(lambda left, up: sign * np.sqrt(0.16 - left**2 - up**2), side=31)
    np.testing.assert_allclose(principal_curvatures(surface, 0.05), sign / 0.4, rtol=2e-3)
    np.testing.assert_allclose(mean_curvature(surface, 0.05), sign / 0.4, rtol=1e-3)
    np.testing.assert_allclose(gaussian_curvature(surface, 0.05), 1 / 0.16, rtol=2e-3)


def test_a_cylinder_bends_one_way_only_in_whichever_direction_it_lies() -> None:
    surface = height_field(lambda left, up: np.sqrt(0.25 - left**2), side=31, turn_rad=0.6)
    curvature = principal_curvatures(surface, 0.05)
    np.testing.assert_allclose(curvature[:, 0], 2.0, rtol=2e-3)
    np.testing.assert_allclose(curvature[:, 1], 0.0, atol=4e-3)


def test_a_saddle_bends_both_ways() -> None:
    surface = height_field(lambda left, up: 2.0 * (left**2 - up**2), turn_rad=0.3)
    np.testing.assert_allclose(principal_curvatures(surface, 0.03)[MIDDLE], [4.0, -4.0], rtol=0.02)


def test_on_a_rough_surface_it_is_the_least_squares_fit_written_out() -> None:
    surface, radius = rough(height_field(lump, side=15), 10), 0.04
    found, rings = principal_curvatures(surface, radius), rings_within(surface, radius)
    for node in (0, 7, 112, 200):
        row = slice(rings.start[node], rings.start[node + 1])
        normal = surface.normals[node].astype(np.float64)
        tangents = np.linalg.svd(normal[None])[2][1:]
        along = (surface.points_m[rings.node[row]] - surface.points_m[node]).astype(np.float64) @ tangents.T
        bend = surface.normals[rings.node[row]].astype(np.float64) @ tangents.T
        none, (u, v) = np.zeros(len(along)), along.T
        rows = np.concatenate([np.stack([u, v, none], axis=1), np.stack([none, u, v], axis=1)])
        weight = np.tile(np.sqrt(1 - (rings.distance_m[row] / radius) ** 2), 2)
        a, b, c = np.linalg.lstsq(rows * weight[:, None], bend.T.ravel() * weight, rcond=None)[0]
        np.testing.assert_allclose(found[node], np.linalg.eigvalsh([[a, b], [b, c]])[::-1], rtol=1e-4, atol=1e-3)


def test_noise_of_a_depth_camera_leaves_the_curvature_of_a_head() -> None:
    exact = height_field(lambda left, up: np.sqrt(0.01 - left**2 - up**2), side=9)
    found = [mean_curvature(rough(exact, seed, 0.002, 0.05), 0.06)[40] for seed in range(30)]
    assert np.median(found) == pytest.approx(10.0, rel=0.05)
    assert np.std(found) < 1.0


def test_nodes_whose_neighbours_or_normal_do_not_tell_have_no_curvature() -> None:
    line, alone = flat_grid(1, 9, 0.02), flat_grid(1, 1, 0.02)
    for surface in (line, alone):
        assert np.isnan(principal_curvatures(surface, 0.05)).all()
        assert np.isnan(mesh_gradient(surface, np.ones(len(surface)))).all()
    nothing = flat_grid(3, 3, 0.02, np.zeros((3, 3), bool))
    assert principal_curvatures(nothing, 0.05).shape == (0, 2)
    assert mesh_gradient(nothing, np.empty(0)).shape == (0, 3)
    surface = height_field(lambda left, up: np.sqrt(0.16 - left**2 - up**2), side=21)
    normals = surface.normals.copy()
    normals[200] = np.nan
    curvature = mean_curvature(replace(surface, normals=normals), 0.05)
    assert np.isnan(curvature[200])
    np.testing.assert_allclose(np.delete(curvature, 200), 2.5, rtol=1e-3)


def test_the_gradient_of_a_linear_function_on_a_plane_is_exact() -> None:
    surface = rough_positions_in_plane(flat_grid(12, 12, 0.02))
    rotation, shift = somewhere(5)
    placed = moved(surface, rotation, shift)
    slope = np.array([3.0, -2.0, 5.0])
    normal = placed.normals[0].astype(np.float64)
    expected = slope - (slope @ normal) * normal
    found = mesh_gradient(placed, placed.points_m.astype(np.float64) @ slope)
    np.testing.assert_allclose(found, np.tile(expected, (len(placed), 1)), atol=2e-4)


def rough_positions_in_plane(surface: Surface) -> Surface:
    points = surface.points_m.copy()
    points[:, 1:] += np.random.default_rng(4).uniform(-0.005, 0.005, (len(points), 2)).astype(np.float32)
    return replace(surface, points_m=points)


def test_a_value_that_is_not_known_costs_its_own_gradient_only_and_there_is_one_a_node() -> None:
    surface = flat_grid(6, 6, 0.02)
    values = surface.points_m[:, 1].astype(np.float64)
    values[14] = np.nan
    gradient = mesh_gradient(surface, values)
    assert np.isnan(gradient[14]).all()
    np.testing.assert_allclose(np.delete(gradient, 14, axis=0), np.tile([0.0, 1.0, 0.0], (35, 1)), atol=1e-5)
    with pytest.raises(ValueError, match="one value each"):
        mesh_gradient(flat_grid(3, 3, 0.02), np.zeros(8))


def test_curvature_and_gradient_move_and_are_renumbered_with_the_surface() -> None:
    surface = rough(height_field(lump), 6)
    rotation, shift = somewhere(7)
    order = np.random.default_rng(8).permutation(len(surface))
    other = renumbered(moved(surface, rotation, shift), order)
    values = np.random.default_rng(9).random(len(surface))
    np.testing.assert_allclose(
        principal_curvatures(other, 0.05), principal_curvatures(surface, 0.05)[order], rtol=1e-3, atol=2e-3
    )
    expected = rotation.apply(mesh_gradient(surface, values)[order])
    np.testing.assert_allclose(mesh_gradient(other, values[order]), expected, rtol=1e-3, atol=0.05)
