"""How finely depth frames resolve what is at a distance."""

from __future__ import annotations

import numpy as np
import pytest
from room_builder import FRONT, ROOM, filtered, picture, shot

from anchorpose.calibration.noise import noise_per_m, step_per_m
from anchorpose.isolation.depth_noise import LIMB_M, DepthDetail
from anchorpose.isolation.empty_room import learn_background

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


def test_a_sharp_recording_resolves_limbs_to_the_end_of_a_room_and_a_filtered_one_does_not():
    empty = picture(FRONT, *ROOM, seed=9)
    sharp = learn_background(empty, [shot(seed) for seed in range(4)], FRONT, 0.0).detail
    soft = learn_background(filtered(empty, 11), [filtered(shot(seed), 11) for seed in range(4)], FRONT, 0.0).detail
    assert not sharp.filtered
    assert sharp.limbs_until_m > 6.0
    assert soft.filtered
    assert soft.limbs_until_m < 2.0
