"""An image of another place is left out; whoever walks through the room, however near, is not taken for one."""

from dataclasses import replace

import numpy as np
import pytest
from room_builder import FRONT, ROOM, body, camera_at, picture

from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.other_place import is_of_other_place, usual_share, without_other_places
from anchorpose.isolation.scene import set_scene
from anchorpose.recording.equipment import Box
from anchorpose.recording.recording import FrameSet

WALK = [picture(FRONT, *ROOM, *body(0.0, z), seed=k) for k, z in enumerate(np.linspace(-0.8, 0.8, 12))]


def model_of(frames, empty=None):
    model = learn_background(empty, frames, FRONT, 0.0)
    return replace(model, usual_share=usual_share(model.depth_m, model.sigma_m, frames))


MODEL = model_of(WALK)
CLOTH = np.full(WALK[0].shape, 0.3, np.float32) + np.random.default_rng(1).normal(0, 0.003, WALK[0].shape)
KNOCKED = {
    "turned to the left": camera_at((2.5, 1.2, 0.0), (1.0, 0.9, -1.5)),
    "turned to the right": camera_at((2.5, 1.2, 0.0), (1.0, 0.9, 1.5)),
    "looking at the ceiling": camera_at((2.5, 1.2, 0.0), (1.0, 2.9, 0.0)),
    "looking at the floor": camera_at((2.5, 1.2, 0.0), (1.6, 0.2, 0.0)),
    "lying on the floor": camera_at((2.5, 0.15, 0.0), (0.0, 0.9, 0.3)),
}


@pytest.mark.parametrize("z", [-1.5, -0.5, 0.0, 0.6])
@pytest.mark.parametrize("x", [-1.0, 0.0, 1.0, 1.9])
def test_a_person_anywhere_in_the_room_is_no_other_place(x, z):
    assert not is_of_other_place(picture(FRONT, *ROOM, *body(0.0, 0.0), *body(x, z), seed=50), MODEL)


def test_a_covered_camera_shows_another_place():
    assert is_of_other_place(CLOTH.astype(np.float32), MODEL)


@pytest.mark.parametrize("how", KNOCKED)
def test_a_camera_that_is_knocked_over_shows_another_place(how):
    assert is_of_other_place(picture(KNOCKED[how], *ROOM, *body(0.0, 0.0), seed=60), MODEL)


def test_a_door_that_opens_in_the_wall_is_no_other_place():
    opened = picture(FRONT, *ROOM, *body(0.0, 0.0), seed=70)
    opened[40:90, 150:180] += 1.5
    assert not is_of_other_place(opened, MODEL)


def test_where_the_room_is_not_known_nothing_is_judged():
    alone = [np.where(picture(FRONT, *body(0.0, 0.0), seed=k) > 0, frame, 0.0) for k, frame in enumerate(WALK)]
    alone = [frame.astype(np.float32) for frame in alone]
    assert not is_of_other_place(CLOTH.astype(np.float32), model_of(alone))
    assert not is_of_other_place(CLOTH.astype(np.float32), model_of(WALK[:2]))


def test_a_picture_of_the_empty_room_that_is_of_another_room_drops_nothing():
    far = picture(
        FRONT, ROOM[0], Box("wall", np.array([-5.0, 1.5, 0.0]), np.array([0.1, 6.0, 12.0]), np.eye(3)), seed=3
    )
    tilted = picture(KNOCKED["looking at the ceiling"], *ROOM, seed=4)
    for empty in (far, tilted):
        model = model_of(WALK, empty)
        assert not any(is_of_other_place(frame, model) for frame in WALK)


def test_the_image_is_dropped_with_a_sentence_and_the_other_camera_stays():
    scenes = [set_scene(replace(FRONT, name=name), MODEL, None) for name in ("front", "left")]
    frame_set = FrameSet(frame=7, time_s=0.7, depths_m=(WALK[0], CLOTH.astype(np.float32)), taken_s=(0.7, 0.71))
    found = without_other_places(frame_set, scenes)
    assert found.depths_m[0] is WALK[0]
    assert found.depths_m[1] is None
    assert found.taken_s == (0.7, None)
    assert found.problems == ("camera left shows another place than usual: it was covered, or moved, for a moment",)
    assert without_other_places(found, scenes) is found
