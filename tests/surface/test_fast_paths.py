"""The compiled shortcuts of links, borders and skin beside their plain forms."""

from dataclasses import replace

import numpy as np
import pytest
from surface_builder import flat_grid, kinect, with_links

from anchorpose.camera import invert_rigid
from anchorpose.errors import DegenerateGeometry
from anchorpose.geodesics.anchors import find_anchors
from anchorpose.geodesics.extrema import surface_center
from anchorpose.surface.hidden import MAX_TURN_DEG, OFF_PLANE_WEIGHT, REACH_M, assign_skin, find_ambiguous_skin
from anchorpose.surface.links import add_links
from anchorpose.surface.mesh import build_surface
from anchorpose.surface.surface import HIDDEN_SKIN, BodyMap, ExpectedSkin

CAMERA = kinect(90, 70)


@pytest.mark.parametrize("seed", range(3))
def test_added_links_are_the_shortest_of_each_pair_both_ways_beside_those_there_were(seed):
    rng = np.random.default_rng(seed)
    surface = with_links(flat_grid(6, 7, 0.01), np.array([[0, 5], [3, 30], [3, 31]]), np.array([0.1, 0.2, 0.3]))
    pairs = rng.integers(0, 50, (80, 2)).astype(np.int32)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    length = rng.uniform(0.05, 0.4, len(pairs)).astype(np.float32)
    least = {(0, 5): 0.1, (3, 30): 0.2, (3, 31): 0.3}
    for (a, b), metres in zip(np.sort(pairs, axis=1).tolist(), length.tolist(), strict=True):
        least[a, b] = min(metres, least.get((a, b), np.inf))
    start, node, metres = add_links(surface, pairs, length, 50)
    found = {(a, int(node[k])): metres[k] for a in range(50) for k in range(start[a], start[a + 1])}
    assert start[-1] == len(node) == len(found) == 2 * len(least)
    for (a, b), wanted in least.items():
        assert found[a, b] == found[b, a] == pytest.approx(wanted)


@pytest.mark.parametrize("seed", range(3))
def test_every_node_shows_the_nearest_of_all_skin_points(seed):
    rng = np.random.default_rng(seed)
    row, col = np.mgrid[: CAMERA.height, : CAMERA.width]
    depth = (2.0 + 0.05 * np.sin(row / 9.0) * np.cos(col / 7.0)).astype(np.float32)
    surface = build_surface(depth, depth > 0, CAMERA)
    chosen = rng.integers(0, len(surface), 200)
    skin = (surface.points_m[chosen] + rng.normal(0, 0.02, (200, 3))).astype(np.float32)
    normals = surface.normals[chosen] + rng.normal(0, 0.4, (200, 3)).astype(np.float32)
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    none = np.zeros((0, 2), np.int32)
    body = BodyMap(np.zeros((200, 4), np.float32), none, none[:, 0], np.zeros(0, np.float32))
    expected = ExpectedSkin(skin, normals, body)
    assert not find_ambiguous_skin(expected).any()
    offset = surface.points_m[:, None].astype(np.float64) - skin
    away2 = (offset**2).sum(axis=2) + (float(OFF_PLANE_WEIGHT) ** 2 - 1) * (offset * normals).sum(axis=2) ** 2
    T_camera_world = invert_rigid(CAMERA.require_pose())
    column, line = CAMERA.project(skin @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]).T
    outside = (column < 0) | (line < 0) | (column >= CAMERA.width) | (line >= CAMERA.height)  # of the picture
    expected_inside = replace(expected, points_m=np.where(outside[:, None], np.float32(9.0), skin))
    shown = assign_skin(surface, CAMERA, expected_inside, np.zeros(200, bool)).skin
    turned = surface.normals @ normals.T <= np.cos(np.radians(MAX_TURN_DEG))
    away = np.where(turned | outside, np.inf, np.sqrt(away2))
    np.testing.assert_array_equal(shown >= 0, away.min(axis=1) < REACH_M)
    assert (shown >= 0).mean() > 0.5
    known = shown >= 0
    np.testing.assert_allclose(away[known, shown[known]], away[known].min(axis=1), atol=1e-5)


@pytest.mark.parametrize("seed", range(2))
def test_ambiguous_skin_has_skin_beside_it_that_is_far_on_the_body(seed):
    rng = np.random.default_rng(seed)
    skin = rng.uniform(0, 0.4, (300, 3)).astype(np.float32)
    landmarks = rng.uniform(0, 0.14, (300, 3)).astype(np.float32)
    none = np.zeros((0, 2), np.int32)
    expected = ExpectedSkin(skin, skin, BodyMap(landmarks, none, none[:, 0], np.zeros(0, np.float32)))
    apart = np.linalg.norm(skin[:, None] - skin, axis=2)
    way = np.abs(landmarks[:, None] - landmarks).max(axis=2)
    wanted = ((apart < 0.08) & (way > 0.12)).any(axis=1)
    assert 0.05 < wanted.mean() < 0.95
    np.testing.assert_array_equal(find_ambiguous_skin(expected), wanted)


def test_a_surface_of_hidden_skin_alone_has_no_anchors_and_no_centre():
    surface = flat_grid(5, 6, 0.01)
    hidden = replace(surface, camera=np.full(len(surface), HIDDEN_SKIN, np.uint8))
    assert not find_anchors(hidden, np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])).found.any()
    with pytest.raises(DegenerateGeometry, match="seen"):
        surface_center(hidden)
