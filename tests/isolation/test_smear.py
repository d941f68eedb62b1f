"""Depth edges that filters have drawn out are measured, and their ramps are no surface."""

from __future__ import annotations

import numpy as np
import pytest
from room_builder import FRONT, ROOM, filtered, picture, shot

from anchorpose.isolation.depth_noise import smear_px, smeared
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.scene import find_pieces, set_scene
from anchorpose.isolation.view import PixelLabel


@pytest.mark.parametrize("width", [7, 11, 13])
def test_the_width_of_drawn_out_edges_is_measured(width):
    found = smear_px([filtered(shot(seed), width) for seed in range(4)])
    assert abs(found - width) <= 2


def test_edges_of_an_unfiltered_camera_are_sharp():
    assert smear_px([shot(seed) for seed in range(4)]) == 0


def test_without_edges_nothing_is_said():
    assert smear_px([picture(FRONT, *ROOM, seed=1)]) == 0


def test_ramps_are_left_out_and_both_sides_kept():
    sharp, width = shot(1), 11
    soft = filtered(sharp, width)
    ramp = smeared(soft, width)
    hanging = (np.abs(soft - sharp) > 0.5) & (np.abs(soft - sharp) < 1.0)  # decimetres from the person and the wall
    assert ramp[hanging].mean() > 0.85  # corners, and where the floor is near, differ by less
    person = sharp < picture(FRONT, *ROOM) - 0.3
    assert ramp[person & (np.abs(soft - sharp) < 0.02)].mean() < 0.02


def test_a_ramp_of_a_smoothing_camera_is_no_reading_and_so_hides_a_person():
    frames = [filtered(shot(seed), 11) for seed in range(4)]
    room = learn_background(filtered(picture(FRONT, *ROOM, seed=9), 11), frames, FRONT, 0.0)
    pieces = find_pieces(frames[0], set_scene(FRONT, room, None))
    depth_m, found = shot(0), pieces.index >= 0
    person = depth_m < picture(FRONT, *ROOM) - 0.3
    off_m = np.abs(pieces.depth_m - depth_m)
    assert off_m[found].max() < 0.45  # the ramp's foot is left, the rest of two metres is not
    assert (found | (pieces.labels == PixelLabel.NO_READING))[person].mean() > 0.9  # hardly seen past
