"""Objects that are moved are room while they rest; people who come and keep still are not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from room_builder import FRONT, ROOM, body, in_front, picture

from anchorpose.isolation.background import RestingLayer, foreground, room_at
from anchorpose.isolation.empty_room import learn_background
from anchorpose.recording.equipment import Box, Cylinder
from anchorpose.rotations import UP, turns_about
from anchorpose.tracker.resting_objects import resting_objects

COUNT, RATE = 24, 6.0
TIMES = [k / RATE for k in range(COUNT)]
MOVES = 12  # the sample in which what is moved comes to rest, or is no longer where it was
HINGE = np.array([-1.0, 0.95, -1.3])
PASSER = body(0.6, 1.0)
STOOL = (
    Box("seat", np.array([-0.3, 0.42, 0.7]), np.array([0.45, 0.06, 0.6]), np.eye(3)),
    Box("legs", np.array([-0.3, 0.2, 0.7]), np.array([0.3, 0.4, 0.45]), np.eye(3)),
)


def door(angle_rad: float) -> Box:
    """A leaf of 0.9 m that turns about its hinge; 0: across the view."""
    R = turns_about(UP, np.array([angle_rad]))[0]
    return Box("door", HINGE + R @ np.array([0.0, 0.0, 0.45]), np.array([0.04, 1.9, 0.9]), R)


def opening(k: int) -> list[Box]:
    return [door(0.0 if k < MOVES else 0.25 * (k - MOVES))] if k < MOVES + 8 else []


def closing(k: int) -> list[Box]:
    return opening(COUNT - 1 - k)


def stool_pushed(k: int) -> list[Box]:
    away_m = 0.15 * max(MOVES - k, 0)
    return [replace(part, center_m=part.center_m + np.array([0.0, 0.0, away_m])) for part in STOOL]


def stander(k: int, sway_m: float = 0.008) -> tuple[Cylinder, ...]:
    """A person who walks in, and then stands and sways."""
    z = 0.15 * max(MOVES - k, 0)
    return body(-0.3 + sway_m * np.sin(1.7 * k), z)


def sitter(k: int, sway_m: float = 0.004) -> tuple[Cylinder, ...]:
    """A person who stands before a place, sits down on it and then only breathes."""
    if k < MOVES:
        return body(0.2, 0.15 * (MOVES - k))
    x = -0.1 + sway_m * np.sin(1.7 * k)
    level = np.array([1.0, 0.0, 0.0])
    return (
        Cylinder("trunk", np.array([x, 0.75, 0.0]), UP, 0.16, 0.6),
        Cylinder("head", np.array([x, 1.2, 0.0]), UP, 0.09, 0.3),
        *(Cylinder("thigh", np.array([x + 0.25, 0.48, z]), level, 0.08, 0.5) for z in (-0.1, 0.1)),
        *(Cylinder("shin", np.array([x + 0.45, 0.24, z]), UP, 0.06, 0.48) for z in (-0.1, 0.1)),
    )


def recorded(moving) -> list[np.ndarray]:
    return [picture(FRONT, *ROOM, *moving(k), seed=k) for k in range(COUNT)]


@cache
def learnt(moving, floor_height_m: float | None = 0.0):
    """The room that is learnt from a recording, and the objects that rest in it."""
    frames = recorded(moving)
    model = learn_background(None, frames, FRONT, floor_height_m)
    return model, resting_objects(frames, TIMES, model, FRONT, floor_height_m)


def left_over(moving, k: int, *people) -> tuple[float, float]:
    """Shares of foreground among the pixels of what is moved, and of people, in a frame with other noise."""
    model, found = learnt(moving)
    model = replace(model, layers=tuple(one.layer for one in found))
    live = picture(FRONT, *ROOM, *moving(k), *people, seed=100 + k)
    mask = foreground(live, model, TIMES[k])
    person = in_front(FRONT, *people) & (picture(FRONT, *ROOM, *moving(k), *people) == picture(FRONT, *ROOM, *people))
    object_seen = in_front(FRONT, *moving(k)) & ~in_front(FRONT, *people)
    return float(mask[object_seen].mean()), float(mask[person].mean()) if people else float("nan")


@pytest.mark.parametrize(("moving", "early", "late"), [(opening, True, False), (closing, False, True)])
def test_a_door_is_room_while_it_rests_and_no_longer(moving, early, late):
    _, found = learnt(moving)
    assert [one.flat for one in found] == [True]
    layer = found[0].layer
    assert (layer.from_s == -np.inf, layer.until_s == np.inf) == (early, late)
    ends_s = layer.until_s if early else TIMES[-1] - layer.from_s
    assert MOVES / RATE - 0.6 < ends_s < MOVES / RATE + 0.1


@pytest.mark.parametrize(("moving", "k"), [(opening, 5), (closing, COUNT - 5), (stool_pushed, COUNT - 5)])
def test_what_rests_is_no_foreground_and_a_person_before_it_is(moving, k):
    model, _ = learnt(moving)
    before = foreground(picture(FRONT, *ROOM, *moving(k), seed=100), model)[in_front(FRONT, *moving(k))].mean()
    assert before > 0.9, "without layers it stands out from the room"
    alone, _ = left_over(moving, k)
    beside, person = left_over(moving, k, *PASSER)
    assert max(alone, beside) < 0.05
    assert person > 0.95


def test_what_still_moves_is_foreground():
    """Where the door was, and where it is: between its places a layer holds for nobody."""
    model, found = learnt(opening)
    model = replace(model, layers=tuple(one.layer for one in found))
    swinging = in_front(FRONT, *opening(MOVES + 3))
    live = picture(FRONT, *ROOM, *opening(MOVES + 3), seed=50)
    assert foreground(live, model, TIMES[MOVES + 3])[swinging].mean() > 0.9


def test_a_stool_is_not_distinguished_from_a_person_where_no_floor_is_seen():
    _, found = learnt(stool_pushed, None)
    assert not found


@pytest.mark.thorough
@pytest.mark.parametrize("moving", [stander, sitter], ids=["stands and sways", "sits and breathes"])
def test_a_person_who_comes_and_keeps_still_is_no_object(moving):
    _, found = learnt(moving)
    assert not found
    _, backward = learnt(lambda k: moving(COUNT - 1 - k))
    assert not backward


def test_what_is_as_low_as_a_stool_and_sways_is_no_object():
    """A child who squats."""
    still = stool_pushed(COUNT)

    def swaying(k: int) -> list[Box]:
        shift = np.array([0.02 * np.sin(1.7 * k), 0.0, 0.15 * max(MOVES - k, 0)])
        return [replace(part, center_m=part.center_m + shift) for part in still]

    assert len(learnt(stool_pushed)[1]) == 1
    assert not learnt(swaying)[1]


@pytest.mark.parametrize("moving", [stander, sitter])
def test_nor_is_a_person_who_does_not_even_sway(moving):
    """A camera that smooths over time shows no sway: the shape decides."""
    _, found = learnt(lambda k: moving(k, 0.0))
    assert not found


def test_legs_that_keep_still_below_a_trunk_that_moves_are_no_stool():
    def restless(k: int):
        legs = [part for part in sitter(k, 0.0) if k < MOVES or part.name in ("thigh", "shin")]
        return legs if k < MOVES else [*legs, *body(-0.15 + 0.1 * np.sin(1.7 * k), 0.0)]

    _, found = learnt(restless)
    assert not found


def test_a_layer_counts_in_its_time_and_not_behind_it():
    room, near = np.full((2, 2), 3.0, np.float32), np.full((2, 2), 2.0, np.float32)
    frame = np.array([[2.0, 2.5], [1.5, 0.0]], np.float32)
    model = learn_background(picture(FRONT, *ROOM, seed=0), [picture(FRONT, *ROOM, seed=1)], FRONT, 0.0)
    sigma = np.full((2, 2), 0.01, np.float32)
    model = replace(model, depth_m=room, sigma_m=sigma, layers=(RestingLayer(near, sigma, 1.0, 2.0),))
    assert room_at(frame, model, 1.5)[0].tolist() == [[2.0, 3.0], [2.0, 2.0]]
    for time_s in (0.9, 2.1, None):
        assert (room_at(frame, model, time_s)[0] == 3.0).all()
