"""Several cameras' meshes become one surface, linked on the same skin only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from surface_builder import FACING_X, kinect, plane_depth, sphere_depth

from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.surface.fusion import FusionConfig, fuse
from anchorpose.surface.mesh import build_surface, links, pieces

FRONT = kinect()


def turned(degrees: float):
    """A camera on the same circle around the vertical axis 2.4 m before the front camera."""
    angle = np.radians(degrees)
    turn = np.eye(4)
    turn[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    return replace(FRONT, name="side", T_world_camera=turn @ FACING_X)


def see_ball(camera, radius_m=0.3):
    depth = sphere_depth(camera, np.array([0, 0, 2.4]), radius_m)
    return build_surface(depth, depth > 0, camera)


def test_two_views_of_a_ball_become_one_piece_with_geodesics_as_on_the_ball():
    cameras = [FRONT, turned(60)]
    surface = fuse([see_ball(camera) for camera in cameras], cameras)
    assert pieces(surface).max() == 0
    level = np.abs(surface.points_m[:, 1] - 1.0) < 0.01
    ends = [np.flatnonzero(level & (surface.camera == k)) for k in (0, 1)]
    bearing = np.arctan2(-surface.points_m[:, 2], surface.points_m[:, 0])
    one, two = ends[0][bearing[ends[0]].argmax()], ends[1][bearing[ends[1]].argmin()]
    arc = 0.3 * (bearing[one] - bearing[two])
    assert geodesic_distance(surface, [one])[0, two] == pytest.approx(abs(arc), rel=0.05)


def test_links_join_cameras_both_ways_and_only_close_nodes():
    cameras = [FRONT, turned(30)]
    surface = fuse([see_ball(camera) for camera in cameras], cameras)
    pair = links(surface)
    assert len(pair) > 500
    assert (surface.camera[pair[:, 0]] != surface.camera[pair[:, 1]]).all()
    assert np.linalg.norm(np.subtract(*surface.points_m[pair.T]), axis=1).max() <= FusionConfig().max_apart_m
    row = np.repeat(np.arange(len(surface)), np.diff(surface.link_start))
    both = set(zip(row.tolist(), surface.link_node.tolist(), strict=True))
    assert all((b, a) in both for a, b in both)


def test_nodes_keep_their_camera_and_its_edges():
    cameras = [FRONT, turned(30)]
    parts = [see_ball(camera) for camera in cameras]
    surface = fuse(parts, cameras)
    for k, part in enumerate(parts):
        own = surface.camera == k
        np.testing.assert_array_equal(surface.points_m[own], part.points_m)
        first = np.flatnonzero(own)[0]
        np.testing.assert_array_equal(np.where(surface.ring[own] >= 0, surface.ring[own] - first, -1), part.ring)


@pytest.mark.parametrize("ahead_m", [0.02, 0.06])
def test_an_arm_is_not_linked_to_the_trunk_behind_it(ahead_m):
    side = turned(0.0)
    trunk = plane_depth(FRONT, np.array([0, 0, 1.0]), 2.4)
    arm = plane_depth(side, np.array([0, 0, 1.0]), 2.4 - ahead_m)
    everywhere = np.ones(trunk.shape, bool)
    parts = [build_surface(trunk, everywhere, FRONT), build_surface(arm, everywhere, side)]
    assert len(links(fuse(parts, [FRONT, side]))) == 0


def test_front_and_back_of_a_thin_sheet_are_not_linked():
    sheet = plane_depth(FRONT, np.array([0, 0, 1.0]), 2.4)
    everywhere = np.ones(sheet.shape, bool)
    cameras = [FRONT, turned(180)]
    assert len(links(fuse([build_surface(sheet, everywhere, camera) for camera in cameras], cameras))) == 0


def test_one_camera_stays_as_it_is_and_an_empty_one_adds_nothing():
    ball = see_ball(FRONT)
    assert fuse([ball], [FRONT]) is ball
    nothing = np.zeros((FRONT.height, FRONT.width), np.float32)
    empty = build_surface(nothing, nothing > 0, turned(30))
    surface = fuse([ball, empty], [FRONT, turned(30)])
    assert len(surface) == len(ball)
    assert len(surface.link_node) == 0


def test_a_surface_without_its_camera_is_refused():
    with pytest.raises(ValueError, match="cameras"):
        fuse([see_ball(FRONT)], [])
    with pytest.raises(ValueError, match="max_apart_m"):
        FusionConfig(max_apart_m=0.0)
