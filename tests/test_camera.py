"""Pixels and metres: projection, back-projection, rigid transforms."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import FRONT, camera_at
from scipy.spatial.transform import Rotation

from anchorpose.camera import invert_rigid, transform_points

BENT = replace(
    FRONT, intrinsics=replace(FRONT.intrinsics, distortion=(0.09, -0.27, 0.001, -0.0005, 0.09))
)  # a Kinect v2's
CAMERAS = pytest.mark.parametrize("camera", [FRONT, BENT], ids=["pinhole", "distorted"])


def some_rigid(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    T[:3, 3] = rng.normal(size=3)
    return T


@CAMERAS
def test_what_is_back_projected_projects_to_its_pixel(camera):
    depth = np.random.default_rng(1).uniform(0.5, 4.5, (camera.height, camera.width)).astype(np.float32)
    points = camera.back_project(depth).reshape(-1, 3)
    column, row = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    expected = np.stack([column.ravel(), row.ravel()], axis=1)
    inner = (np.abs(expected - [256.0, 212.0]) < [200.0, 170.0]).all(axis=1)
    # OpenCV undoes the lens by iteration, to hundredths of a pixel
    np.testing.assert_allclose(camera.project(points)[inner], expected[inner], atol=0.05)


def test_a_pixel_right_and_down_lies_right_and_down_of_the_axis():
    depth = np.zeros((FRONT.height, FRONT.width), np.float32)
    depth[212 + 73, 256 + 146] = 2.5
    np.testing.assert_allclose(FRONT.back_project(depth)[285, 402], [1.0, 0.5, 2.5], atol=1e-6)


@CAMERAS
def test_depth_zero_is_no_point(camera):
    points = camera.back_project(np.zeros((camera.height, camera.width), np.float32))
    assert np.isnan(points).all()
    assert points.dtype == np.float32


def test_points_behind_the_camera_and_on_it_have_no_pixel():
    pixels = FRONT.project(np.array([[0.1, 0.2, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    assert np.isnan(pixels[:2]).all()
    np.testing.assert_allclose(pixels[2], [256.0, 212.0])
    _, _, inside = FRONT.pixel_of(np.array([[0.1, 0.2, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    np.testing.assert_array_equal(inside, [False, False, True])


def test_pixels_reach_half_a_pixel_beyond_their_centre_and_no_farther():
    def at(column: float, row: float) -> np.ndarray:
        return np.array([[(column - 256.0) / 365.0, (row - 212.0) / 365.0, 1.0]])

    for place, inside in (((-0.4, 3.0), True), ((511.4, 423.4), True), ((-0.6, 3.0), False), ((511.6, 10.0), False)):
        assert FRONT.pixel_of(at(*place))[2][0] == inside, place
    for place in ((10.0, 423.6), (10.0, -0.6)):
        assert not FRONT.pixel_of(at(*place))[2][0], place
    found_column, found_row, _ = FRONT.pixel_of(at(100.4, 50.6))
    assert (found_column[0], found_row[0]) == (100, 51)


def test_the_position_is_the_centre_of_projection_and_without_a_pose_it_is_refused():
    lost = replace(FRONT, T_world_camera=None)
    with pytest.raises(ValueError, match="front"):
        lost.require_pose()
    with pytest.raises(ValueError, match="unknown"):
        _ = lost.position_m
    camera = camera_at((1.0, 1.5, -2.0), (0.0, 1.0, 0.0))
    np.testing.assert_allclose(camera.position_m, [1.0, 1.5, -2.0])
    ahead = transform_points(invert_rigid(camera.require_pose()), np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(ahead[:2], 0.0, atol=1e-12)
    assert ahead[2] > 0


@pytest.mark.parametrize("seed", range(3))
def test_a_transform_and_its_inverse_undo_each_other(seed):
    T = some_rigid(seed)
    np.testing.assert_allclose(invert_rigid(T) @ T, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(invert_rigid(T), np.linalg.inv(T), atol=1e-12)
    points = np.random.default_rng(seed).normal(size=(4, 5, 3))
    np.testing.assert_allclose(transform_points(invert_rigid(T), transform_points(T, points)), points, atol=1e-12)


def test_transforms_apply_from_right_to_left():
    first, second = some_rigid(5), some_rigid(6)
    points = np.random.default_rng(7).normal(size=(9, 3))
    np.testing.assert_allclose(
        transform_points(second @ first, points), transform_points(second, transform_points(first, points)), atol=1e-12
    )
    homogeneous = np.column_stack([points, np.ones(9)]) @ first.T
    np.testing.assert_allclose(transform_points(first, points), homogeneous[:, :3], atol=1e-12)


@CAMERAS
def test_a_look_compares_each_point_with_the_reading_of_its_own_pixel(camera):
    depth_m = np.random.default_rng(3).uniform(1.0, 4.0, (camera.height, camera.width)).astype(np.float32)
    row, column = np.array([5, 100, 200]), np.array([7, 150, 300])
    pixels = np.zeros_like(depth_m)
    pixels[row, column] = 2.5
    own_m = camera.back_project(pixels)[row, column]
    points_m = transform_points(camera.require_pose(), np.vstack([own_m, [[0.0, 0.0, -1.0]]]))
    own, read, inside = camera.look(points_m, depth_m)
    np.testing.assert_allclose(own[:3], 2.5, atol=1e-5)
    np.testing.assert_array_equal(read[:3], depth_m[row, column])
    assert inside.tolist() == [True, True, True, False]
