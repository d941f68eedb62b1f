"""Several cameras' meshes become one surface, linked on the same skin only."""

from dataclasses import replace

import numpy as np
import pytest
from surface_builder import FACING_X, kinect, plane_depth, sphere_depth

from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.surface.links import links, pieces
from anchorpose.surface.mesh import build_surface
from anchorpose.surface.patient_surface import fuse
from anchorpose.surface.surface import SurfaceConfig

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
    pair, length = links(surface)
    assert len(pair) > 100
    assert (surface.camera[pair[:, 0]] != surface.camera[pair[:, 1]]).all()
    np.testing.assert_allclose(length, np.linalg.norm(np.subtract(*surface.points_m[pair.T]), axis=1), atol=1e-6)
    assert length.max() <= SurfaceConfig().fusion_max_apart_m
    row = np.repeat(np.arange(len(surface)), np.diff(surface.link_start))
    both = set(zip(row.tolist(), surface.link_node.tolist(), strict=True))
    assert all((b, a) in both for a, b in both)


def test_where_both_see_the_same_skin_one_sheet_stays_whose_nodes_keep_places_and_edges():
    cameras = [FRONT, turned(30)]
    parts = [see_ball(camera) for camera in cameras]
    surface = fuse(parts, cameras)
    share = len(surface) / sum(len(part) for part in parts)
    assert 0.5 < share < 0.8
    both = np.abs(surface.points_m[:, 1] - 1.0) < 0.2  # away from the outline, where neither sees all corners
    bearing = (surface.points_m - [0, 1, 0])[both] / 0.3
    camera = surface.camera[both]
    for k in (0, 1):
        other = (cameras[1 - k].position_m - [0, 1, 0]) / 2.4
        assert (bearing[camera == k] @ other).max() < 0.995  # nothing of the other's own middle is kept
    for k, part in enumerate(parts):
        whole = {tuple(pixel): row for row, pixel in enumerate(part.pixel.tolist())}
        own = np.flatnonzero(surface.camera == k)
        there = np.array([whole[tuple(pixel)] for pixel in surface.pixel[own].tolist()])
        np.testing.assert_array_equal(surface.points_m[own], part.points_m[there])
        back = np.full(len(part) + 1, -1)
        back[there] = own
        np.testing.assert_array_equal(surface.ring[own], back[part.ring[there]])


def test_no_seam_lengthens_a_way_around_the_ball():
    cameras = [turned(-40), turned(40)]
    surface = fuse([see_ball(camera) for camera in cameras], cameras)
    bearing = (surface.points_m - [0, 1, 0]) / 0.3
    bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
    source = int(np.argmax(bearing @ [0.5, 0.0, 0.87]))
    arc = 0.3 * np.arccos(np.clip(bearing @ bearing[source], -1, 1))
    inside = bearing[:, 0] > 0.35
    error = geodesic_distance(surface, [source])[0][inside] - arc[inside]
    assert np.abs(error).mean() < 0.003
    assert np.abs(error).max() < 0.010


@pytest.mark.parametrize("ahead_m", [0.02, 0.06])
def test_an_arm_is_not_linked_to_the_trunk_behind_it(ahead_m):
    side = turned(0.0)
    trunk = plane_depth(FRONT, np.array([0, 0, 1.0]), 2.4)
    arm = plane_depth(side, np.array([0, 0, 1.0]), 2.4 - ahead_m)
    everywhere = np.ones(trunk.shape, bool)
    parts = [build_surface(trunk, everywhere, FRONT), build_surface(arm, everywhere, side)]
    assert len(fuse(parts, [FRONT, side]).link_node) == 0


def test_front_and_back_of_a_thin_sheet_are_not_linked():
    sheet = plane_depth(FRONT, np.array([0, 0, 1.0]), 2.4)
    everywhere = np.ones(sheet.shape, bool)
    cameras = [FRONT, turned(180)]
    assert len(fuse([build_surface(sheet, everywhere, camera) for camera in cameras], cameras).link_node) == 0


def test_one_camera_stays_as_it_is_an_empty_one_adds_nothing_and_a_surface_without_its_camera_is_refused():
    ball = see_ball(FRONT)
    assert fuse([ball], [FRONT]) is ball
    nothing = np.zeros((FRONT.height, FRONT.width), np.float32)
    empty = build_surface(nothing, nothing > 0, turned(30))
    surface = fuse([ball, empty], [FRONT, turned(30)])
    assert (len(surface), len(surface.link_node)) == (len(ball), 0)
    with pytest.raises(ValueError, match="cameras"):
        fuse([see_ball(FRONT)], [])
    shown = replace(see_ball(FRONT), skin=np.zeros(len(see_ball(FRONT)), np.int32))
    with pytest.raises(ValueError, match="refer to expected skin"):
        fuse([shown, shown], [FRONT, turned(30)])
    with pytest.raises(ValueError, match="fusion_max_apart_m"):
        SurfaceConfig(fusion_max_apart_m=0.0)
