"""Which of the objects that rest are left out of the room: people on the floor, the named patient, the equipment."""

from __future__ import annotations

from functools import cache

import numpy as np
from body_builder import adult_body, photograph, skin_in, standing, stepped
from room_builder import FRONT, ROOM, picture

from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.scene import set_scene
from anchorpose.recording.equipment import Box, EquipmentModel
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.resting_objects import resting_objects, with_resting_objects

COUNT, RATE, ARRIVES = 24, 6.0, 10
SEATED = standing(LeftUpLeg=(0, 0, 90), RightUpLeg=(0, 0, 90))


def stool(z: float) -> Box:
    return Box("stool", np.array([-0.3, 0.22, z]), np.array([0.4, 0.44, 0.5]), np.eye(3))


@cache
def on_the_floor() -> np.ndarray:
    """Depth of an adult who sits on the floor."""
    skin = skin_in(stepped(SEATED, -0.3, 0.0, 0.0), adult_body())
    return photograph(skin - np.array([0.0, skin[:, 1].min(), 0.0]), FRONT).depth_m


@cache
def samples(seated: bool) -> tuple[FrameSet, ...]:
    """A stool that is pushed, or a person who comes and sits without any movement; then nothing changes."""
    frames = []
    for k in range(COUNT):
        depth = picture(FRONT, *ROOM, *(() if seated else (stool(0.15 * max(ARRIVES - k, 0)),)), seed=k)
        if seated and k >= ARRIVES:
            depth = np.where(on_the_floor() > 0, np.minimum(on_the_floor(), depth), depth)
        frames.append(FrameSet(frame=k, time_s=k / RATE, depths_m=(depth.astype(np.float32),)))
    return tuple(frames)


def layers(seated: bool, equipment: EquipmentModel | None = None, named=None, empty: np.ndarray | None = None) -> int:
    seen = samples(seated)
    model = learn_background(empty, [one.depths_m[0] for one in seen], FRONT, 0.0)
    return len(with_resting_objects(set_scene(FRONT, model, None), 0, seen, 0.0, equipment, named).background.layers)


def test_a_stool_that_is_pushed_is_room_while_it_rests():
    assert layers(False) == 1


def test_a_person_on_the_floor_who_keeps_still_is_not():
    seen = samples(True)
    frames, times = [one.depths_m[0] for one in seen], [one.time_s for one in seen]
    model = learn_background(None, frames, FRONT, 0.0)
    found = resting_objects(frames, times, model, FRONT, 0.0)
    assert [one.flat for one in found] == [False], "low, whole, still: only the body shows a person"
    assert layers(True) == 0


def test_where_the_user_named_the_patient_nothing_becomes_room():
    assert layers(False, named=(-0.3, 0.0)) == 0
    assert layers(False, named=(-0.3, 1.5)) == 1


def test_what_rests_within_the_equipment_stays():
    at = EquipmentModel((Box("plate", np.array([-0.3, 0.02, 0.0]), np.array([0.8, 0.04, 0.8]), np.eye(3)),))
    away = EquipmentModel((Box("plate", np.array([-0.3, 0.02, 2.0]), np.array([0.8, 0.04, 0.8]), np.eye(3)),))
    assert (layers(False, at), layers(False, away)) == (0, 1)


def test_from_a_picture_of_the_empty_room_everything_stands_out():
    assert layers(False, empty=picture(FRONT, *ROOM, seed=99)) == 0
