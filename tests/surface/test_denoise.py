"""Smoothing follows the noise of the frame, and keeps edges."""

import numpy as np
import pytest
from surface_builder import kinect, plane_depth

from anchorpose.surface.denoise import denoise, drop_flying_pixels, estimate_noise, jump_coefficients

CAMERA = kinect()
EVERYWHERE = np.ones((CAMERA.height, CAMERA.width), bool)
SLANTED = plane_depth(CAMERA, np.array([0.3, 0.2, 0.93]), 2.2)


@pytest.mark.parametrize("sigma_m", [0.0005, 0.002, 0.008])
def test_the_noise_estimate_is_the_noise_that_was_added(sigma_m):
    rng = np.random.default_rng(3)
    noisy = SLANTED + rng.normal(0, sigma_m, SLANTED.shape) * (SLANTED / 2.4) ** 2
    assert estimate_noise(noisy, EVERYWHERE) * 2.4**2 == pytest.approx(sigma_m, rel=0.1)


@pytest.mark.parametrize(("sigma_m", "step_m", "left"), [(0.003, 0.001, 0.4), (0.0, 0.02, 0.6), (0.004, 0.015, 0.6)])
def test_smoothing_removes_most_of_noise_and_steps(sigma_m, step_m, left):
    rng = np.random.default_rng(4)
    raw = np.round((SLANTED + rng.normal(0, sigma_m, SLANTED.shape)) / step_m) * step_m
    inner = np.s_[4:-4, 4:-4]
    error = np.std((denoise(raw, EVERYWHERE) - SLANTED)[inner])
    assert error < left * np.std((raw - SLANTED)[inner])


def test_a_depth_edge_is_not_blended_and_is_no_depth_step():
    rng = np.random.default_rng(5)
    depth = np.full((40, 40), 2.4, np.float32)
    depth[:, 20:] = 2.25
    smooth = denoise(depth + rng.normal(0, 0.003, depth.shape), np.ones(depth.shape, bool))
    assert np.abs(smooth - depth).max() < 0.01
    assert estimate_noise(depth, np.ones(depth.shape, bool)) == 0.0


def test_a_frame_without_noise_is_left_alone_nothing_outside_the_mask_survives_and_the_mask_must_fit():
    depth = np.full((20, 20), 2.0, np.float32)
    mask = np.zeros(depth.shape, bool)
    mask[5:10, 5:10] = True
    np.testing.assert_array_equal(denoise(depth, mask), np.where(mask, depth, 0))
    with pytest.raises(ValueError, match="mask"):
        denoise(np.ones((4, 4), np.float32), np.ones((4, 5), bool))


def test_holes_stay_holes_and_do_not_pull_their_rim():
    rng = np.random.default_rng(6)
    depth = (2.0 + rng.normal(0, 0.003, (30, 30))).astype(np.float32)
    depth[10:20, 10:20] = 0.0
    smooth = denoise(depth, np.ones(depth.shape, bool))
    assert (smooth[10:20, 10:20] == 0).all()
    assert np.abs(smooth[depth > 0] - 2.0).max() < 0.02


def test_flying_pixels_go_and_a_fingertip_stays():
    depth = np.full((30, 30), 0.0, np.float32)
    depth[:, :10] = 2.0  # an arm
    depth[:, 12:] = 2.6  # the trunk behind it
    depth[5, 10] = depth[15, 11] = 2.3  # mixed readings in between
    depth[20:25, 10:12] = 2.0  # a finger, two pixels wide
    slope, spread = jump_coefficients(365.0, 0.0005)
    kept = drop_flying_pixels(depth, slope, spread, 3) > 0
    assert not kept[5, 10]
    assert not kept[15, 11]
    assert kept[20:25, 10:12].all()
    assert kept[:, :10].all()
