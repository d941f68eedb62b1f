"""Lenses against OpenCV's forward projection, which is exact; its way back is not."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from anchorpose.camera import Camera
from anchorpose.lens import Intrinsics, LensModel, lens_array, rays_of_pixels

WIDTH, HEIGHT = 160, 144
AZURE = (0.4357, 0.0126, -2.4e-5, -6.4e-5, -0.0019, 0.7739, 0.0885, -0.0051)  # of the order of real calibrations
BROWN = (-0.2, 0.1, 0.001, -0.002, -0.03)
LENSES = {
    "brown": (LensModel.BROWN_CONRADY, BROWN),
    "azure": (LensModel.RATIONAL, AZURE),
    "prism": (LensModel.RATIONAL, (*AZURE, 0.001, -0.002, 0.002, 0.001)),
    "tilted": (LensModel.RATIONAL, (*AZURE, 0.001, -0.002, 0.002, 0.001, 0.03, -0.02)),
    "fisheye": (LensModel.KANNALA_BRANDT, (-0.02, 0.003, -0.001, 0.0002)),
}


def intrinsics(name: str, valid_radius: float | None = None) -> Intrinsics:
    model, coefficients = LENSES[name]
    pinhole = Intrinsics(fx=126.0, fy=127.0, cx=80.3, cy=71.2)
    return replace(pinhole, distortion=coefficients, model=model, valid_radius=valid_radius)


def by_opencv(lens: Intrinsics, points: np.ndarray) -> np.ndarray:
    none = np.zeros(3)
    project = cv2.fisheye.projectPoints if lens.model is LensModel.KANNALA_BRANDT else cv2.projectPoints
    return project(points[:, None], none, none, lens.matrix, np.array(lens.distortion))[0].reshape(-1, 2)


def camera(lens: Intrinsics) -> Camera:
    size = {"width": WIDTH, "height": HEIGHT, "depth_scale": 0.001}
    return Camera(name="front", **size, intrinsics=lens, T_world_camera=np.eye(4))


@pytest.mark.parametrize("name", LENSES)
def test_points_fall_where_opencv_has_them(name):
    points = np.random.default_rng(1).uniform((-1.5, -1.2, 2.0), (1.5, 1.2, 4.0), (500, 3))
    lens = intrinsics(name)
    assert camera(lens).project(points) == pytest.approx(by_opencv(lens, points), abs=1e-9)


@pytest.mark.parametrize("name", LENSES)
def test_the_ray_of_a_pixel_falls_on_that_pixel(name):
    lens = intrinsics(name)
    rays = rays_of_pixels(lens, WIDTH, HEIGHT)
    row, column = np.nonzero(np.isfinite(rays[..., 0]))
    assert len(row) > 0.95 * WIDTH * HEIGHT
    points = np.column_stack([rays[row, column], np.ones(len(row))])
    assert np.abs(by_opencv(lens, points) - np.column_stack([column, row])).max() < 1e-5


def test_nothing_is_read_beyond_the_valid_radius():
    lens = intrinsics("azure", valid_radius=0.5)
    rays = rays_of_pixels(lens, WIDTH, HEIGHT)
    inside = np.isfinite(rays[..., 0])
    assert 0.2 < inside.mean() < 0.9
    assert np.hypot(rays[..., 0], rays[..., 1])[inside].max() <= 0.5
    assert np.isnan(camera(lens).project(np.array([[0.6, 0.0, 1.0], [0.4, 0.0, 1.0]])))[:, 0].tolist() == [True, False]


def test_a_lens_that_turns_back_is_valid_as_far_as_it_goes_out():
    """Barrel distortion of one coefficient: r (1 - k r^2) grows up to r = 1 / sqrt(3 k)."""
    lens = Intrinsics(fx=100.0, fy=100.0, cx=80.0, cy=72.0, distortion=(-0.25, 0.0, 0.0, 0.0, 0.0))
    assert lens_array(lens)[5] == pytest.approx(1.0 / np.sqrt(0.75), abs=2e-3)
    rays = rays_of_pixels(lens, 400, 144)
    assert np.isnan(rays[72, 399]).all()
    assert np.isfinite(rays[72, 150]).all()


def test_a_model_named_by_a_text_is_that_model_and_an_unknown_one_is_refused():
    lens = intrinsics("fisheye")
    by_name = replace(lens, model="kannala-brandt")
    assert by_name == lens
    np.testing.assert_array_equal(lens_array(by_name), lens_array(lens))
    with pytest.raises(ValueError, match="fisheye"):
        replace(lens, model="fisheye")
