"""One camera's picture becomes a mesh with the right shape, cut where the body is cut and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from surface_builder import kinect, plane_depth, sphere_depth

from anchorpose.camera import transform_points
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.surface.joins import join_pieces
from anchorpose.surface.links import pieces
from anchorpose.surface.mesh import build_surface, edges, faces, keep_nodes
from anchorpose.surface.surface import SurfaceConfig

CAMERA = kinect()
EVERYWHERE = np.ones((CAMERA.height, CAMERA.width), bool)


def mesh(depth_m, config=None, bridge=None, camera=CAMERA):
    return build_surface(depth_m, depth_m > 0, camera, config, bridge)


def joined(depth_m):
    config = SurfaceConfig()
    return join_pieces(mesh(depth_m), config.step, config.max_join_m)


def directions_in_camera(surface):
    return surface.normals @ CAMERA.T_world_camera[:3, :3]


@pytest.mark.parametrize("normal", [(0, 0, 1.0), (0.6, 0, 0.8), (0.5, 0.5, 0.7071), (-0.9, 0.1, 0.4243)])
def test_normals_of_a_plane_are_exact_however_it_slants(normal):
    normal = np.array(normal) / np.linalg.norm(normal)
    surface = mesh(plane_depth(CAMERA, normal, 2.0 * normal[2]))
    np.testing.assert_allclose(directions_in_camera(surface), np.broadcast_to(-normal, (len(surface), 3)), atol=2e-3)


def test_normals_of_a_sphere_are_radial_and_look_at_the_camera_and_every_neighbour_names_the_node_back():
    centre = np.array([0.05, -0.03, 2.4])
    surface = mesh(sphere_depth(CAMERA, centre, 0.3))
    radial = surface.points_m - transform_points(CAMERA.T_world_camera, centre)
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    to_camera = CAMERA.position_m - surface.points_m
    cosine = (surface.normals * radial).sum(axis=1)
    assert np.degrees(np.arccos(np.clip(np.median(cosine), -1, 1))) < 1.0
    assert np.percentile(cosine, 2) > np.cos(np.radians(10))  # flat to the ray only the near side of the fit is seen
    assert ((surface.normals * to_camera).sum(axis=1) > 0).all()
    surface = mesh(sphere_depth(CAMERA, np.array([0, 0, 2.4]), 0.3))
    node, place = np.nonzero(surface.ring >= 0)
    other = surface.ring[node, place]
    np.testing.assert_array_equal(surface.ring[other, (place + 4) % 8], node)


def test_faces_cover_a_sheet_once_and_turn_towards_the_camera():
    surface = mesh(np.full((CAMERA.height, CAMERA.width), 2.0, np.float32))
    a, b, c = surface.points_m[faces(surface)].transpose(1, 0, 2)
    turned = np.cross(b - a, c - a) / 2.0
    sheet = np.ptp(surface.points_m[:, 1]) * np.ptp(surface.points_m[:, 2])
    assert np.linalg.norm(turned, axis=1).sum() == pytest.approx(sheet, rel=1e-4)
    assert (turned[:, 0] > 0).all()  # the camera looks along -X


def test_faces_of_a_ragged_sheet_are_unique_and_stand_on_edges():
    rng = np.random.default_rng(2)
    depth = np.where(rng.random((CAMERA.height, CAMERA.width)) < 0.85, 2.0, 0.0).astype(np.float32)
    surface = mesh(depth, SurfaceConfig(step=1, min_support=0))
    triangle = np.sort(faces(surface), axis=1)
    assert len(np.unique(triangle, axis=0)) == len(triangle)
    known = {tuple(pair) for pair in edges(surface).tolist()}
    sides = np.concatenate([triangle[:, [0, 1]], triangle[:, [1, 2]], triangle[:, [0, 2]]])
    assert {tuple(side) for side in sides.tolist()} <= known
    a, b, c = surface.points_m[faces(surface)].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 0] > 0).all()


def test_an_arm_before_the_trunk_is_apart_from_it():
    depth = np.full((CAMERA.height, CAMERA.width), 2.4, np.float32)
    depth[30:70, 50:66] = 2.25
    surface = joined(depth)
    assert (pieces(surface).max(), len(surface.link_node)) == (1, 0)


def test_an_arm_that_hangs_from_the_shoulder_is_joined_nowhere_else():
    depth = np.full((CAMERA.height, CAMERA.width), 2.4, np.float32)
    depth[20:80, 50:66] = (2.4 - np.minimum(np.arange(60) * 0.004, 0.08))[:, None]  # leaves the trunk gradually
    surface = joined(depth)
    assert (pieces(surface).max(), len(surface.link_node)) == (0, 0)
    low = surface.pixel[:, 0] == 78
    across = edges(surface)[low[edges(surface)].all(axis=1)]
    assert np.abs(np.diff(surface.points_m[across][:, :, 0], axis=1)).max() < 0.04


def test_skin_seen_at_seventy_degrees_holds_together():
    normal = np.array([np.sin(np.radians(70)), 0, np.cos(np.radians(70))])
    rng = np.random.default_rng(1)
    depth = plane_depth(CAMERA, normal, 2.4 * normal[2])
    depth = np.where(np.abs(np.arange(CAMERA.width) - 63.5) < 16, depth + rng.normal(0, 0.002, depth.shape), 0)
    surface = mesh(depth.astype(np.float32))
    assert pieces(surface).max() == 0
    assert len(surface) > 0.97 * (CAMERA.height // 2) * 16


def test_a_chin_before_the_neck_is_joined_to_it():
    depth = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    depth[60:, 20:100] = 2.4  # shoulders and neck
    depth[10:60, 50:80] = 2.33
    surface = joined(depth)
    assert pieces(surface).max() == 0
    assert len(surface.link_node) > 0
    assert pieces(mesh(depth)).max() == 1


def test_small_components_are_left_out_and_hands_are_not():
    depth = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    depth[20:80, 20:60] = 2.4
    depth[30:33, 80:83] = 2.4  # 4 square centimetres
    depth[60:74, 80:94] = 2.4  # 85 square centimetres
    surface = mesh(depth)
    assert pieces(surface).max() == 1
    assert not ((surface.pixel[:, 0] < 40) & (surface.pixel[:, 1] > 70)).any()


def shins(bar: slice, camera=CAMERA):
    """Two upright cylinders at 2.4 m, a bar before both; (depth without the bar's pixels, pixels the bar hides)."""
    u = camera.pixel_rays()[..., 0]
    depth = np.zeros((camera.height, camera.width), np.float32)
    for centre in (-0.1, 0.1):
        a, b, c = u**2 + 1.0, u * centre + 2.4, centre**2 + 2.4**2 - 0.055**2
        root = b * b - a * c
        depth = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, depth)
    hidden = np.zeros(depth.shape, bool)
    hidden[bar] = True
    return np.where(hidden, 0.0, depth).astype(np.float32), hidden


def test_a_bar_before_the_shins_cuts_no_leg():
    depth, hidden = shins(np.s_[45:60])  # 10 cm
    assert pieces(mesh(depth)).max() == 3
    surface = mesh(depth, bridge=hidden)
    assert pieces(surface).max() == 1
    top, bottom = (np.flatnonzero((surface.pixel[:, 0] == row) & (surface.pixel[:, 1] < 64))[4] for row in (10, 94))
    straight = np.linalg.norm(surface.points_m[top] - surface.points_m[bottom])
    assert geodesic_distance(surface, [top])[0, bottom] == pytest.approx(straight, rel=0.03)


def test_a_post_between_the_legs_joins_no_legs():
    depth, _ = shins(np.s_[0:0])
    hidden = np.zeros(depth.shape, bool)
    hidden[:, 56:72] = True
    assert pieces(mesh(np.where(hidden, 0, depth), bridge=hidden)).max() == 1


def test_a_gap_that_nothing_hides_or_a_bar_wider_than_the_limit_is_not_bridged():
    depth, hidden = shins(np.s_[45:60])
    assert pieces(mesh(depth, bridge=np.zeros_like(hidden))).max() == 3
    depth, hidden = shins(np.s_[42:66])  # 16 cm
    config = SurfaceConfig(bridge_max_width_m=0.12)
    assert len(mesh(depth, config, hidden).link_node) == 0


def test_a_moved_camera_moves_the_surface_and_changes_nothing_else():
    rng = np.random.default_rng(8)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    moved = np.eye(4)
    moved[:3, :3] = rotation * np.sign(np.linalg.det(rotation))
    moved[:3, 3] = [0.4, -1.0, 2.0]
    depth, hidden = shins(np.s_[45:60])
    surface = mesh(depth, bridge=hidden)
    camera = replace(CAMERA, T_world_camera=moved @ CAMERA.T_world_camera)
    other = build_surface(depth, depth > 0, camera, bridge=hidden)
    np.testing.assert_allclose(other.points_m, transform_points(moved, surface.points_m), atol=1e-5)
    np.testing.assert_allclose(other.normals, surface.normals @ moved[:3, :3].T, atol=1e-5)
    np.testing.assert_array_equal(edges(other), edges(surface))


def test_a_part_of_a_surface_keeps_exactly_the_edges_within_it():
    depth, hidden = shins(np.s_[45:60])
    surface = mesh(depth, bridge=hidden)
    keep = np.random.default_rng(9).random(len(surface)) < 0.7
    part, old = keep_nodes(surface, keep), np.flatnonzero(keep)
    wanted = {tuple(pair) for pair in edges(surface)[keep[edges(surface)].all(axis=1)].tolist()}
    assert {tuple(pair) for pair in old[edges(part)].tolist()} == wanted
    np.testing.assert_array_equal(part.points_m, surface.points_m[keep])


def test_an_empty_mask_gives_an_empty_surface_and_no_pose_or_another_size_is_refused():
    surface = build_surface(np.ones((CAMERA.height, CAMERA.width), np.float32), ~EVERYWHERE, CAMERA, bridge=EVERYWHERE)
    assert len(surface) == 0
    assert len(edges(surface)) == len(faces(surface)) == len(pieces(surface)) == 0
    depth = np.ones((CAMERA.height, CAMERA.width), np.float32)
    with pytest.raises(ValueError, match="pose"):
        build_surface(depth, EVERYWHERE, kinect(T_world_camera=None))
    with pytest.raises(ValueError, match="frames of"):
        build_surface(depth[:-1], EVERYWHERE[:-1], CAMERA)


@pytest.mark.parametrize(
    ("name", "value"),
    [("step", 0), ("min_piece_m2", -1.0), ("max_join_m", -0.1), ("min_support", 9), ("denoise_radius_px", 0)],
)
def test_an_impossible_mesh_is_refused(name, value):
    with pytest.raises(ValueError, match=name):
        SurfaceConfig(**{name: value})
