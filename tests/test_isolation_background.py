"""The empty room, with a picture of it and without: what stands out and what does not."""

from __future__ import annotations

import numpy as np
import pytest
from room_builder import FRONT, NOISE_PER_M, ROOM, body, in_front, picture

from anchorpose.camera import transform_points
from anchorpose.isolation.background import BackgroundSource, foreground
from anchorpose.isolation.config import IsolationConfig
from anchorpose.isolation.empty_room import learn_background
from anchorpose.recording.equipment import Box

CONFIG = IsolationConfig()
EMPTY = picture(FRONT, *ROOM, seed=0)
EMPTY_FRAMES = [picture(FRONT, *ROOM, seed=k) for k in range(1, 5)]


def test_nobody_is_foreground_in_an_empty_room():
    model = learn_background(EMPTY, EMPTY_FRAMES, FRONT, 0.0, CONFIG)
    assert model.source == BackgroundSource.PICTURE
    assert foreground(picture(FRONT, *ROOM, seed=9), model, CONFIG).mean() < 1e-3


def test_a_body_is_foreground_down_to_its_soles():
    model = learn_background(EMPTY, EMPTY_FRAMES, FRONT, 0.0, CONFIG)
    depth, expected = picture(FRONT, *ROOM, *body(0, 0), seed=9), in_front(FRONT, *body(0, 0))
    found = foreground(depth, model, CONFIG)
    assert (found & expected).sum() > 0.97 * expected.sum()
    assert (found & ~expected).sum() < 0.02 * expected.sum()
    lowest = np.nanmin(transform_points(FRONT.T_world_camera, FRONT.back_project(np.where(found, depth, 0)))[..., 1])
    assert lowest < 0.03


def test_sigma_is_the_noise_of_picture_and_reading_together():
    model = learn_background(EMPTY, EMPTY_FRAMES, FRONT, 0.0, CONFIG)
    seen = EMPTY > 0
    assert np.median(model.sigma_m[seen] / EMPTY[seen] ** 2) == pytest.approx(np.sqrt(2) * NOISE_PER_M, rel=0.15)


def test_readings_where_the_background_has_none_are_foreground():
    hole = EMPTY.copy()
    hole[40:140, 100:160] = 0
    model = learn_background(hole, EMPTY_FRAMES, FRONT, 0.0, CONFIG)
    depth, expected = picture(FRONT, *ROOM, *body(0, 0), seed=9), in_front(FRONT, *body(0, 0))
    assert (foreground(depth, model, CONFIG) & expected).sum() > 0.97 * expected.sum()


def test_without_a_picture_a_body_that_walks_by_leaves_the_room_as_background():
    walk = [picture(FRONT, *ROOM, *body(0.0, z), seed=k) for k, z in enumerate(np.linspace(-1.5, 1.5, 12))]
    model = learn_background(None, walk, FRONT, 0.0, CONFIG)
    assert model.source == BackgroundSource.RECORDING
    expected = in_front(FRONT, *body(0.0, 0.0))
    found = foreground(picture(FRONT, *ROOM, *body(0.0, 0.0), seed=20), model, CONFIG)
    assert (found & expected).sum() > 0.95 * expected.sum()


def test_without_a_picture_a_patient_who_sways_in_place_is_no_background():
    sway = [picture(FRONT, *ROOM, *body(0.0, 0.04 * np.sin(k)), seed=k) for k in range(12)]
    model = learn_background(None, sway, FRONT, 0.0, CONFIG)
    expected = in_front(FRONT, *body(0.0, 0.0))
    found = foreground(picture(FRONT, *ROOM, *body(0.0, 0.0), seed=20), model, CONFIG)
    assert (found & expected).sum() > 0.85 * expected.sum()


def test_a_cupboard_that_never_moves_is_background():
    cupboard = Box("cupboard", np.array([-0.5, 0.9, 0.6]), np.array([0.4, 1.8, 0.6]), np.eye(3))
    still = [picture(FRONT, *ROOM, cupboard, seed=k) for k in range(12)]
    model = learn_background(None, still, FRONT, 0.0, CONFIG)
    assert foreground(picture(FRONT, *ROOM, cupboard, seed=20), model, CONFIG).mean() < 2e-3


def test_a_recording_of_people_only_is_all_foreground():
    alone = picture(FRONT, *body(0, 0), seed=1)
    model = learn_background(None, [alone], FRONT, None, CONFIG)
    assert model.source == BackgroundSource.REMOVED
    assert (foreground(alone, model, CONFIG) & (alone > 0)).sum() > 0.97 * (alone > 0).sum()
