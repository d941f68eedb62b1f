"""The lens of a CameraInfo: each model, rectified images, regions and joined pixels, and what is refused."""

from dataclasses import replace

import pytest

from anchorpose.lens import LensModel, rays_of_pixels
from anchorpose.sources.ros_messages import CameraInfo
from anchorpose.sources.ros_streams import image_size, lens_of

INFO = CameraInfo(
    frame_id="optical",
    height=480,
    width=640,
    model="plumb_bob",
    D=(0.1, -0.05, 0.001, 0.002, 0.01),
    K=(500.0, 0, 319.5, 0, 510.0, 239.5, 0, 0, 1),
    P=(480.0, 0, 310.0, 0, 0, 490.0, 230.0, 0, 0, 0, 1, 0),
    binning=(0, 0),
    roi=(0, 0, 0, 0),
)
EIGHT = (0.5, -0.2, 0.001, 0.002, 0.01, 0.3, -0.1, 0.02)


@pytest.mark.parametrize(
    ("model", "D", "wanted", "kept"),
    [
        ("plumb_bob", INFO.D, LensModel.BROWN_CONRADY, INFO.D),
        ("plumb_bob", INFO.D[:4], LensModel.BROWN_CONRADY, (*INFO.D[:4], 0.0)),
        ("plumb_bob", EIGHT, LensModel.RATIONAL, EIGHT),
        ("rational_polynomial", EIGHT, LensModel.RATIONAL, EIGHT),
        ("equidistant", EIGHT[:4], LensModel.KANNALA_BRANDT, EIGHT[:4]),
        ("fisheye", EIGHT[:4], LensModel.KANNALA_BRANDT, EIGHT[:4]),
        ("", (), LensModel.BROWN_CONRADY, (0.0,) * 5),
        ("Inverse Brown Conrady", (0.0,) * 5, LensModel.BROWN_CONRADY, (0.0,) * 5),
    ],
)
def test_each_model_by_its_ros_name(model: str, D: tuple[float, ...], wanted: LensModel, kept: object) -> None:
    lens = lens_of(replace(INFO, model=model, D=D), rectified=False).intrinsics
    assert (lens.model, lens.distortion) == (wanted, kept)
    assert (lens.fx, lens.fy, lens.cx, lens.cy) == (500.0, 510.0, 319.5, 239.5)


def test_rectified_images_have_the_projection_and_no_distortion() -> None:
    lens = lens_of(INFO, rectified=True).intrinsics
    assert (lens.fx, lens.fy, lens.cx, lens.cy) == (480.0, 490.0, 310.0, 230.0)
    assert not any(lens.distortion)
    assert lens_of(replace(INFO, D=(float("nan"),) * 5), rectified=True).intrinsics == lens


def test_the_shortest_focal_length_is_that_of_the_full_image() -> None:
    binned = replace(INFO, K=(1.5, *INFO.K[1:]), binning=(2, 2))
    assert lens_of(binned, rectified=False).intrinsics.fx == 0.75


def test_a_region_of_joined_pixels_sees_along_the_same_rays() -> None:
    """A pixel of 2 x 2 joined ones looks where the middle of the four does."""
    part = replace(INFO, D=(), binning=(2, 2), roi=(100, 60, 240, 320))
    assert image_size(part) == (160, 120)
    full, joined = lens_of(replace(INFO, D=()), False).intrinsics, lens_of(part, False).intrinsics
    rays = rays_of_pixels(full, 640, 480)
    middle = rays[60 + 2 * 7 : 60 + 2 * 7 + 2, 100 + 2 * 9 : 100 + 2 * 9 + 2].mean(axis=(0, 1))
    assert rays_of_pixels(joined, 160, 120)[7, 9] == pytest.approx(middle, abs=1e-9)


@pytest.mark.parametrize(
    ("info", "rectified", "why"),
    [
        (replace(INFO, model="Inverse Brown Conrady"), False, "not known"),
        (replace(INFO, D=EIGHT[:3]), False, "3 coefficients"),
        (replace(INFO, K=(0.0,) * 9), False, "not calibrated"),
        (replace(INFO, K=(float("nan"), *INFO.K[1:])), False, "not calibrated"),
        (replace(INFO, P=(0.0,) * 12), True, "P is missing"),
        (replace(INFO, K=(1e-30, *INFO.K[1:])), False, "not calibrated"),
        (replace(INFO, D=(1e30, 0.0, 0.0, 0.0, 0.0)), False, "not calibrated"),
    ],
)
def test_a_lens_that_cannot_be_used_says_why(info: CameraInfo, rectified: bool, why: str) -> None:
    lens = lens_of(info, rectified)
    assert lens.intrinsics is None
    assert why in lens.problem
