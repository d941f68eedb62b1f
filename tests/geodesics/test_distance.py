"""Geodesic distance against shapes whose geodesics are known, laws of a distance, and Dijkstra."""

from dataclasses import replace

import numpy as np
import pytest
from spectral_builder import shuffled
from surface_builder import flat_grid, grid_surface, kinect, sphere_depth, with_links

from anchorpose.geodesics.distance import geodesic_distance, geodesic_distance_to_set
from anchorpose.research.geodesic_solvers import Solver, solve_distance
from anchorpose.surface.mesh import build_surface

SPACING = 0.013  # every second pixel of a Kinect v2 at 2.4 m


def bumpy(seed=0, rows=20, cols=24):
    rng = np.random.default_rng(seed)
    row, col = np.mgrid[:rows, :cols] * SPACING
    height = 0.03 * np.sin(12 * row) * np.cos(9 * col) + rng.normal(0, 0.001, row.shape)
    return grid_surface(np.stack([height, -row, -col], axis=2))


@pytest.mark.parametrize("source", [0, 500, 1234])
def test_on_a_plane_it_is_the_straight_line_to_the_micrometre(source):
    surface = flat_grid(40, 50, SPACING)
    straight = np.linalg.norm(surface.points_m - surface.points_m[source], axis=1)
    np.testing.assert_allclose(geodesic_distance(surface, [source])[0], straight, atol=2e-6)


@pytest.mark.parametrize("shear", [(1.0, 3.0, 0.0), (2.5, 1.0, 0.5), (1.0, 1.0, 0.8)])
def test_on_a_plane_seen_slantwise_it_stays_within_a_few_millimetres(shear):
    wide, tall, skew = shear
    row, col = np.mgrid[:40, :50] * SPACING
    surface = grid_surface(np.stack([0 * row, -tall * row, -wide * col - skew * row], axis=2))
    straight = np.linalg.norm(surface.points_m - surface.points_m[1010], axis=1)
    error = geodesic_distance(surface, [1010])[0] - straight
    assert np.abs(error).mean() < 0.002
    assert np.abs(error).max() < 0.008


def test_on_a_cylinder_it_is_the_straight_line_of_the_unrolled_sheet():
    radius, length, turn = 0.15, 0.8, np.pi
    along, angle = np.meshgrid(np.linspace(0, length, 62), np.linspace(0, turn, 37), indexing="ij")
    points = np.stack([radius * np.sin(angle), -along, radius * np.cos(angle)], axis=2)
    surface = grid_surface(points)
    source = 5 * 37 + 3
    flat = np.stack([along, radius * angle], axis=2).reshape(-1, 2)
    error = geodesic_distance(surface, [source])[0] - np.linalg.norm(flat - flat[source], axis=1)
    assert np.abs(error).max() < 0.002


def test_on_a_ball_seen_by_a_camera_it_is_the_great_circle():
    camera, centre, radius = kinect(), np.array([0, 0, 2.4]), 0.3
    depth = sphere_depth(camera, centre, radius)
    surface = build_surface(depth, depth > 0, camera)
    middle = camera.require_pose()[:3, :3] @ centre + camera.position_m
    bearing = surface.points_m - middle
    bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
    source = int(np.argmax(bearing[:, 0]))
    arc = radius * np.arccos(np.clip(bearing @ bearing[source], -1, 1))
    seen_well = arc < radius * np.radians(65)  # at the rim a pixel is 3 cm of skin
    error = (geodesic_distance(surface, [source])[0] - arc)[seen_well]
    assert np.abs(error).mean() < 0.001
    assert np.abs(error).max() < 0.004


def test_around_a_wall_it_bends_at_the_wall_s_end():
    present = np.ones((41, 41), bool)
    present[20, :30] = False
    surface = flat_grid(41, 41, SPACING, present)
    index = np.full(present.shape, -1)
    index[present] = np.arange(len(surface))
    source, target, corner = index[10, 5], index[30, 5], np.array([20, 30]) * SPACING
    leg = np.linalg.norm(corner - np.array([10, 5]) * SPACING)
    assert geodesic_distance(surface, [source])[0, target] == pytest.approx(2 * leg, rel=0.02)


def test_it_is_symmetric_and_keeps_the_triangle_inequality():
    surface = bumpy()
    nodes = np.random.default_rng(1).integers(0, len(surface), 12)
    between = geodesic_distance(surface, nodes)[:, nodes].astype(np.float64)
    np.testing.assert_allclose(between, between.T, atol=0.003)
    assert (between[:, None, :] <= between[:, :, None] + between[None, :, :] + 0.004).all()


def test_it_is_never_shorter_than_the_straight_line_nor_much_longer_than_the_best_path_of_edges():
    surface = bumpy()
    field = geodesic_distance(surface, [100])[0]
    straight = np.linalg.norm(surface.points_m - surface.points_m[100], axis=1)
    assert (field >= straight - 1e-4).all()
    assert (field <= solve_distance(surface, [100], solver=Solver.DIJKSTRA)[0] + 1e-5).all()


def test_a_rigid_motion_changes_no_distance():
    surface = bumpy()
    rotation = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    moved = replace(surface, points_m=(surface.points_m @ rotation.T + [1.0, -2.0, 3.0]).astype(np.float32))
    np.testing.assert_allclose(geodesic_distance(moved, [33]), geodesic_distance(surface, [33]), atol=2e-5)


def test_the_order_of_the_nodes_changes_no_distance():
    surface = bumpy()
    order = np.random.default_rng(3).permutation(len(surface))
    found = geodesic_distance(shuffled(surface, order), [np.argsort(order)[77]])[0]
    np.testing.assert_allclose(found, geodesic_distance(surface, [77])[0][order], atol=1e-6)


def test_another_piece_of_surface_is_infinitely_far_and_a_link_makes_it_near():
    present = np.ones((20, 30), bool)
    present[:, 14] = False
    surface = flat_grid(20, 30, SPACING, present)
    field = geodesic_distance(surface, [0])[0]
    right = surface.pixel[:, 1] > 14
    assert np.isinf(field[right]).all()
    assert np.isfinite(field[~right]).all()
    pair = [[13, 14]]  # across the gap in the first row
    linked = geodesic_distance(with_links(surface, pair), [0])[0]
    assert linked[14] == pytest.approx(15 * SPACING, abs=1e-5)
    assert np.isfinite(linked).all()
    longer = geodesic_distance(with_links(surface, pair, [0.5]), [0])[0]
    assert longer[14] == pytest.approx(13 * SPACING + 0.5, abs=1e-5)


def test_the_distance_to_a_set_is_that_to_its_nearest_member():
    surface = flat_grid(30, 30, SPACING)
    sources = np.array([0, 400, 899])
    nearest = geodesic_distance(surface, sources).min(axis=0)
    assert np.abs(geodesic_distance_to_set(surface, sources) - nearest).max() < 0.003


def test_dijkstra_follows_edges_exactly():
    surface = flat_grid(10, 10, SPACING)
    row, col = surface.pixel.astype(np.float64).T
    steps = np.maximum(row, col) + (np.sqrt(2) - 1) * np.minimum(row, col)
    np.testing.assert_allclose(solve_distance(surface, [0], solver=Solver.DIJKSTRA)[0], steps * SPACING, rtol=1e-5)
