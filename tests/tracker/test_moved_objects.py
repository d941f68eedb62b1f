"""Objects that are moved are room while they rest; people who come and keep still are not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from room_builder import FRONT, ROOM, body, in_front, picture, seated

from anchorpose.isolation.background import BackgroundModel, RestingLayer, foreground, room_at
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.scene import set_scene
from anchorpose.recording.equipment import Box
from anchorpose.recording.recording import FrameSet
from anchorpose.rotations import UP, turns_about
from anchorpose.tracker.resting_objects import with_resting_objects

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


def coming(person, sway_m: float = 0.0):
    """A person who walks in, and then keeps still in a posture, or sways."""
    return lambda k: body(-0.3, 0.15 * (MOVES - k)) if k < MOVES else person(-0.3 + sway_m * np.sin(1.7 * k))


def stands(x: float) -> tuple:
    return body(x, 0.0)


def sits(x: float) -> tuple:
    return seated(x, 0.0)


def on_the_floor(x: float) -> tuple:
    return body(x, 0.0, LeftUpLeg=(0.0, 0.0, 90.0), RightUpLeg=(0.0, 0.0, 90.0))


def child_squats(x: float) -> tuple:
    bent = {
        f"{side}{bone}": (0.0, 0.0, turn)
        for side in ("Left", "Right")
        for bone, turn in (("UpLeg", 100.0), ("Leg", -110.0))
    }
    return body(x, 0.0, 1.1, **bent)


def recorded(moving) -> list[np.ndarray]:
    return [picture(FRONT, *ROOM, *moving(k), seed=k) for k in range(COUNT)]


@cache
def learnt(moving, empty: bool = False) -> BackgroundModel:
    """The room that is learnt from a recording, or known from a picture of it, with the objects that rest in it."""
    frames = recorded(moving)
    model = learn_background(picture(FRONT, *ROOM, seed=99) if empty else None, frames, FRONT, 0.0)
    samples = [FrameSet(frame=k, time_s=TIMES[k], depths_m=(frame,)) for k, frame in enumerate(frames)]
    return with_resting_objects(set_scene(FRONT, model, None), 0, samples).background


def left_over(moving, k: int, *people) -> tuple[float, float]:
    """Shares of foreground among the pixels of what is moved, and of people, in a frame with other noise."""
    live = picture(FRONT, *ROOM, *moving(k), *people, seed=100 + k)
    mask = foreground(live, learnt(moving), TIMES[k])
    person = in_front(FRONT, *people) & (picture(FRONT, *ROOM, *moving(k), *people) == picture(FRONT, *ROOM, *people))
    object_seen = in_front(FRONT, *moving(k)) & ~in_front(FRONT, *people)
    return float(mask[object_seen].mean()), float(mask[person].mean()) if people else float("nan")


@pytest.mark.parametrize(("moving", "early", "late"), [(opening, True, False), (closing, False, True)])
def test_a_door_is_room_while_it_rests_and_no_longer(moving, early, late):
    (layer,) = learnt(moving).layers
    assert (layer.from_s == -np.inf, layer.until_s == np.inf) == (early, late)
    ends_s = layer.until_s if early else TIMES[-1] - layer.from_s
    assert MOVES / RATE - 0.6 < ends_s < MOVES / RATE + 0.1


@pytest.mark.parametrize(("moving", "k"), [(opening, 5), (closing, COUNT - 5), (stool_pushed, COUNT - 5)])
def test_what_rests_is_no_foreground_and_a_person_before_it_is(moving, k):
    without = replace(learnt(moving), layers=())
    before = foreground(picture(FRONT, *ROOM, *moving(k), seed=100), without)[in_front(FRONT, *moving(k))].mean()
    assert before > 0.9, "without layers it stands out from the room"
    alone, _ = left_over(moving, k)
    beside, person = left_over(moving, k, *PASSER)
    assert max(alone, beside) < 0.05
    assert person > 0.95


def test_what_still_moves_is_foreground():
    """Where the door was, and where it is: between its places a layer holds for nobody."""
    swinging = in_front(FRONT, *opening(MOVES + 3))
    live = picture(FRONT, *ROOM, *opening(MOVES + 3), seed=50)
    assert foreground(live, learnt(opening), TIMES[MOVES + 3])[swinging].mean() > 0.9


def test_from_a_picture_of_the_empty_room_everything_stands_out():
    assert learnt(stool_pushed, empty=True).layers == ()


@pytest.mark.parametrize("backward", [False, pytest.param(True, marks=pytest.mark.thorough)])
@pytest.mark.parametrize(
    ("person", "sway_m"), [(stands, 0.008), (sits, 0.004), (on_the_floor, 0.0), (child_squats, 0.0)]
)
def test_a_person_who_comes_and_keeps_still_is_no_object(person, sway_m, backward):
    moving = coming(person, sway_m)
    assert learnt((lambda k: moving(COUNT - 1 - k)) if backward else moving).layers == ()


def test_legs_that_keep_still_below_a_trunk_that_moves_are_no_stool():
    """A person who sits and bends forward and back."""

    def restless(k: int) -> tuple:
        lean_deg = -15.0 + 15.0 * np.sin(1.7 * k)
        return coming(sits)(k) if k < MOVES else seated(-0.3, 0.0, LowerBack=(0.0, 0.0, lean_deg))

    assert learnt(restless).layers == ()


def test_a_layer_counts_in_its_time_and_not_behind_it():
    room, near = np.full((2, 2), 3.0, np.float32), np.full((2, 2), 2.0, np.float32)
    frame = np.array([[2.0, 2.5], [1.5, 0.0]], np.float32)
    model = learn_background(picture(FRONT, *ROOM, seed=0), [picture(FRONT, *ROOM, seed=1)], FRONT, 0.0)
    sigma = np.full((2, 2), 0.01, np.float32)
    model = replace(model, depth_m=room, sigma_m=sigma, layers=(RestingLayer(near, sigma, 1.0, 2.0),))
    assert room_at(frame, model, 1.5)[0].tolist() == [[2.0, 3.0], [2.0, 2.0]]
    for time_s in (0.9, 2.1, None):
        assert (room_at(frame, model, time_s)[0] == 3.0).all()
