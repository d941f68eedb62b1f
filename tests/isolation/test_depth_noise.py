"""The noise of a camera, measured on the still background of its own recording."""

import cv2
import numpy as np
import pytest
from body_builder import FRONT as BODY_CAMERA
from body_builder import adult_body, seen_body, standing
from room_builder import FRONT, ROOM, body, filtered, picture, shot

from anchorpose.calibration.first_frames import noise_per_m, step_per_m
from anchorpose.camera import Camera
from anchorpose.descriptor.people import people_mask
from anchorpose.isolation import depth_noise
from anchorpose.isolation.background import BackgroundSource
from anchorpose.isolation.depth_noise import (
    LIMB_M,
    DepthDetail,
    DepthNoise,
    measure_detail,
    measure_noise,
    neighbour_noise,
    smear_px,
    smeared,
)
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.scene import find_pieces, set_scene
from anchorpose.isolation.view import PixelLabel
from anchorpose.lens import Intrinsics

CAMERA = Camera(
    name="front",
    width=320,
    height=240,
    depth_scale=0.001,
    intrinsics=Intrinsics(fx=260.0, fy=260.0, cx=160.0, cy=120.0),
    T_world_camera=np.eye(4),
)
SIGMA_M = 0.010


def wall(angle_deg: float = 0.0, distance_m: float = 2.5) -> np.ndarray:
    """(240, 320) depth of a plane that meets the optical axis at a distance, turned about the vertical."""
    across = CAMERA.pixel_rays()[..., 0]
    return (distance_m / (1.0 - np.tan(np.radians(angle_deg)) * across)).astype(np.float32)


def errors(seed: int, patch_px: float = 0.0) -> np.ndarray:
    """(240, 320) normal errors of one sigma; patch_px: sigma of the Gaussian window that neighbours share."""
    white = np.random.default_rng(seed).standard_normal((240, 320)).astype(np.float32)
    if not patch_px:
        return white
    return cv2.GaussianBlur(white, (0, 0), patch_px) * np.float32(2.0 * np.sqrt(np.pi) * patch_px)


def measured(room_m: np.ndarray, frames_m: list[np.ndarray], sigma_m: float = SIGMA_M) -> DepthNoise:
    return measure_noise(room_m, np.full_like(room_m, sigma_m), frames_m, CAMERA, 0.001)


def test_independent_noise_of_a_wall_is_found():
    frames = [wall() + SIGMA_M * errors(k) for k in range(7)]
    found = measured(wall(), frames)
    assert found.measured
    assert float(found.sigma_m(np.array(2.5))) == pytest.approx(SIGMA_M, rel=0.03)
    assert found.shared_px == pytest.approx(1.0, abs=0.1)
    assert found.holes == 0.0


@pytest.mark.parametrize("patch_px", [1.0, 2.2, 4.0])
def test_how_many_pixels_share_an_error_is_found_and_does_not_change_sigma(patch_px):
    """The autocorrelation of a Gaussian window is a Gaussian sqrt(2) as wide: its integral is 4 pi patch_px^2."""
    frames = [wall() + SIGMA_M * errors(k, patch_px) for k in range(7)]
    found = measured(wall(), frames)
    assert float(found.sigma_m(np.array(2.5))) == pytest.approx(SIGMA_M, rel=0.1)
    assert found.shared_px == pytest.approx(4.0 * np.pi * patch_px**2, rel=0.15)


def test_what_is_shared_is_found_beneath_noise_of_each_pixel():
    """Half of the variance is each pixel's own: its peak counts 1, the hill 4 pi 3^2."""
    frames = [wall() + SIGMA_M * np.sqrt(0.5) * (errors(k) + errors(k + 50, 3.0)) for k in range(7)]
    found = measured(wall(), [frame.astype(np.float32) for frame in frames])
    assert float(found.sigma_m(np.array(2.5))) == pytest.approx(SIGMA_M, rel=0.1)
    assert found.shared_px == pytest.approx(0.5 + 0.5 * 4.0 * np.pi * 9.0, rel=0.15)


def test_the_mean_of_a_patch_is_as_uncertain_as_the_shared_pixels_say():
    """The oracle of ``shared_px``: patches of 40x40 pixels, far larger than what is shared."""
    found = measured(wall(), [wall() + SIGMA_M * errors(k, 2.2) for k in range(7)])
    patches = [SIGMA_M * errors(k, 2.2).reshape(6, 40, 8, 40).mean(axis=(1, 3)) for k in range(100, 160)]
    assert np.std(patches) == pytest.approx(SIGMA_M * np.sqrt(found.shared_px) / 40.0, rel=0.15)


def test_noise_that_grows_with_distance_is_found_at_each_depth_and_keeps_its_power_beyond():
    room = np.concatenate([wall(0.0, distance)[:80] for distance in (1.25, 2.25, 3.25)])
    frames = [(room + 0.002 * room**2 * errors(k)).astype(np.float32) for k in range(7)]
    found = measured(room, frames, 0.03)
    depth_m = np.array([1.25, 1.8, 2.25, 3.25, 6.5])
    np.testing.assert_allclose(found.sigma_m(depth_m), 0.002 * depth_m**2, rtol=0.1)


def test_a_slanted_and_a_steep_surface_have_their_own_noise():
    """Half of the image faces the camera, at the same depths the other half is slanted, with 1.5 times the noise."""
    room = np.concatenate([wall()[:120], wall(50.0)[:120]])
    slanted = np.zeros(room.shape, bool)
    slanted[120:] = True
    frames = [(room + SIGMA_M * np.where(slanted, 1.5, 1.0) * errors(k)).astype(np.float32) for k in range(7)]
    found = measured(room, frames, 0.03)
    at = np.array(2.5)
    assert float(found.sigma_m(at)) == pytest.approx(SIGMA_M, rel=0.15)
    assert float(found.sigma_m(at, np.array(50.0))) == pytest.approx(1.5 * SIGMA_M, rel=0.15)


def test_people_who_pass_and_pixels_that_are_lost_are_no_noise():
    rng, frames = np.random.default_rng(5), []
    for k in range(7):
        frame = wall() + SIGMA_M * errors(k)
        frame[60:200, 30 * k : 30 * k + 80] = 1.8
        frame[rng.random(frame.shape) < 0.05] = 0.0
        frames.append(frame)
    found = measured(wall(), frames)
    assert float(found.sigma_m(np.array(2.5))) == pytest.approx(SIGMA_M, rel=0.03)
    assert found.holes == pytest.approx(0.05, abs=0.01)


def test_a_coarse_scale_on_which_most_readings_repeat_is_not_without_noise():
    """Steps of 20 mm and noise of 5 mm: two readings of three are alike, so a median would find nothing."""
    step = 0.020
    room = wall() + np.linspace(0.0, 0.2, 240, dtype=np.float32)[:, None]
    frames = [np.round((room + 0.005 * errors(k)) / step) * step for k in range(7)]
    expected = np.std([frame - room for frame in frames])
    found = measured(room, [frame.astype(np.float32) for frame in frames], 0.01)
    assert 0.5 * expected < float(found.sigma_m(np.array(2.6))) < 1.1 * expected


def test_readings_between_the_two_sides_of_an_edge_are_flying():
    room = wall()
    room[:, 160:] += 1.0
    frames = []
    for k in range(7):
        frame = room + np.float32(0.005) * errors(k)
        frame[::4, 160] = 3.0  # one row in four reads half way, in one of the four columns beside the edge
        frames.append(frame)
    assert measured(room, frames, 0.01).flying == pytest.approx(1.0 / 16.0, rel=0.05)


def test_what_was_seen_once_is_not_measured_but_stated():
    found = measured(wall(), [wall()])
    assert found == neighbour_noise(0.001)
    assert not found.measured
    assert float(found.sigma_m(np.array(2.0))) == pytest.approx(0.004)


def test_a_recording_of_people_alone_has_no_background_to_measure_on():
    model = learn_background(None, [picture(FRONT, *body(0.0, 0.0), seed=k) for k in range(6)], FRONT, None)
    assert model.source is BackgroundSource.REMOVED
    assert model.sensor.noise == neighbour_noise(model.sensor.noise_per_m)
    assert not model.sensor.noise.measured


DETAIL = DepthDetail(edge_px=12.0, focal_px=303.0, step_per_m=0.003)


def test_twice_the_distance_is_twice_the_width_and_four_times_the_step():
    assert DETAIL.edge_m(4.0) == pytest.approx(2.0 * DETAIL.edge_m(2.0))
    assert DETAIL.step_m(4.0) == pytest.approx(4.0 * DETAIL.step_m(2.0))


def test_an_edge_is_as_wide_as_a_limb_at_the_distance_that_is_stated():
    assert DETAIL.edge_m(DETAIL.limbs_until_m) == pytest.approx(LIMB_M)
    assert DETAIL.limbs_until_m == pytest.approx(2.02, abs=0.01)


@pytest.mark.parametrize("gain", [8.0, 30.0])
def test_the_step_of_a_camera_that_measures_disparity_is_found(gain):
    """Depth is gain over a whole number: the step is z^2 over gain."""
    disparity = np.round(np.linspace(gain / 4.0 * 8.0, gain * 8.0, 64 * 48)) / 8.0
    depth_m = (gain / disparity).reshape(48, 64).astype(np.float32)
    assert step_per_m([depth_m, depth_m]) == pytest.approx(1.0 / (8.0 * gain), rel=0.1)


def test_a_frame_of_one_value_has_no_step():
    assert step_per_m([np.full((4, 4), 2.0, np.float32)]) == 0.0
    assert noise_per_m([np.full((4, 4), 2.0, np.float32)]) == 0.0


def two_people(seed: int) -> np.ndarray:
    """Two people whom the descriptor recognises, in the room."""
    return picture(FRONT, *ROOM, *body(0.0, -0.5), *body(0.0, 0.5), seed=seed)


def test_a_sharp_recording_resolves_limbs_to_the_end_of_a_room_and_a_filtered_one_does_not():
    empty = picture(FRONT, *ROOM, seed=9)
    sharp = learn_background(empty, [two_people(seed) for seed in range(4)], FRONT, 0.0).sensor
    frames = [filtered(two_people(seed), 11) for seed in range(4)]
    soft = learn_background(filtered(empty, 11), frames, FRONT, 0.0).sensor
    assert not sharp.filtered
    assert sharp.limbs_until_m > 6.0
    assert soft.filtered
    assert soft.limbs_until_m < 2.0


@pytest.mark.parametrize("width", [7, 11, 13])
def test_the_width_of_drawn_out_edges_is_measured(width):
    found = smear_px([filtered(shot(seed), width) for seed in range(4)])
    assert abs(found - width) <= 2


def test_edges_of_an_unfiltered_camera_are_sharp():
    assert smear_px([shot(seed) for seed in range(4)]) == 0


def test_without_edges_nothing_is_said():
    assert smear_px([picture(FRONT, *ROOM, seed=1)]) is None


def test_ramps_are_left_out_and_both_sides_kept():
    sharp, width = shot(1), 11
    soft = filtered(sharp, width)
    ramp = smeared(soft, width)
    hanging = (np.abs(soft - sharp) > 0.5) & (np.abs(soft - sharp) < 1.0)  # decimetres from the person and the wall
    assert ramp[hanging].mean() > 0.85  # corners, and where the floor is near, differ by less
    person = sharp < picture(FRONT, *ROOM) - 0.3
    assert ramp[person & (np.abs(soft - sharp) < 0.02)].mean() < 0.02


def test_a_ramp_of_a_smoothing_camera_is_no_reading_and_so_hides_a_person(monkeypatch):
    """Pillars stand for people, since filters also fill the gaps between legs; the descriptor would not find them."""
    monkeypatch.setattr(depth_noise, "people_mask", lambda depth_m, _: depth_m < picture(FRONT, *ROOM) - 0.3)
    frames = [filtered(shot(seed), 11) for seed in range(4)]
    room = learn_background(filtered(picture(FRONT, *ROOM, seed=9), 11), frames, FRONT, 0.0)
    pieces = find_pieces(frames[0], set_scene(FRONT, room, None))
    depth_m, found = shot(0), pieces.index >= 0
    person = depth_m < picture(FRONT, *ROOM) - 0.3
    off_m = np.abs(pieces.depth_m - depth_m)
    assert off_m[found].max() < 0.45  # the ramp's foot is left, the rest of two metres is not
    assert (found | (pieces.labels == PixelLabel.NO_READING))[person].mean() > 0.9  # hardly seen past


def slanted_boards(depth_m: np.ndarray, wall_behind: bool = True) -> np.ndarray:
    """The image of a person before a far wall, and boards beside; readings of the wall only behind the thighs, or not
    even there.
    """
    image = np.where(depth_m < 4.0, depth_m, np.float32(0.0))
    if wall_behind:
        image[220:300] = depth_m[220:300]
    image[:, :128] = np.interp(np.arange(128) % 64, [0, 8, 20, 40, 52, 64], [4.0, 4.0, 2.5, 2.5, 4.0, 4.0])
    return image


def person_before_wall(width_px: int) -> np.ndarray:
    """The image of a filtering camera; a width of 1 pixel filters nothing."""
    return filtered(seen_body(standing(), adult_body()).views[0].depth_m, width_px)


@pytest.mark.parametrize("width_px", [1, 11])
def test_slanted_boards_do_not_hide_that_the_outlines_of_people_are_sharp(width_px):
    image = slanted_boards(person_before_wall(width_px))
    assert smear_px([image]) >= 10
    assert measure_detail([image], BODY_CAMERA).filtered == (width_px > 1)


def test_slanted_boards_are_no_filter_where_nothing_behind_the_people_is_read():
    """No outline has a reading on its far side, so no filter could have drawn a ramp there."""
    images = [slanted_boards(person_before_wall(1), wall_behind=False)] * 4
    assert smear_px(images) >= 10
    assert smear_px(images, [people_mask(image, BODY_CAMERA) for image in images]) is None
    assert not measure_detail(images, BODY_CAMERA).filtered
