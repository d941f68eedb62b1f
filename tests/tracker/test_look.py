"""Empty rooms, mannequins, posters, pushed furniture and legs alone are nobody; a patient who stands still is found."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from body_builder import adult_body, photograph, skin_in, standing, stepped
from room_builder import FRONT, ROOM, camera_at, picture

from anchorpose.camera import Camera
from anchorpose.recording.equipment import Box
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.look import NOT_A_PERSON
from anchorpose.tracker.preparation import HARDLY_MOVES, Settled, furnish_room
from anchorpose.tracker.room import NO_REVIEW, NOBODY_SEEN, Room
from anchorpose.tracker.start import NoStart

COUNT = 8
LOW = camera_at((1.3, 0.55, 0.0), (0.0, 0.1, 0.0))  # sees less than 0.8 m of a person who stands 1.3 m away
POSTER = Box("poster", np.array([-1.98, 1.3, 0.7]), np.array([0.02, 0.9, 0.7]), np.eye(3))


def adult(camera: Camera, x: float, z: float) -> np.ndarray:
    """(height, width) depth of a naked adult alone, 0 around."""
    return photograph(skin_in(stepped(standing(), x, 0.0, z), adult_body()), camera).depth_m


def room_of(*places, camera: Camera = FRONT, parts=(), config: TrackConfig | None = None) -> Room:
    """What is known of a recording; places: x, z of somebody in each frame, None: nobody; parts: of each frame."""
    frames = []
    for k, place in enumerate(places):
        depth = picture(camera, *ROOM, *(parts[k] if parts else ()), seed=k)
        if place is not None:
            person = adult(camera, *place)
            depth = np.where((person > 0) & (person < depth), person, depth)
        frames.append(FrameSet(frame=k, time_s=k / 5, depths_m=(depth.astype(np.float32),)))
    recording = SimpleNamespace(backgrounds_m=(None,), equipment=None)
    calibration = SimpleNamespace(cameras=(camera,), floor_height_m=0.0)
    settled = Settled(recording, None, calibration, tuple(range(len(frames))), tuple(frames))
    return furnish_room(settled, config or TrackConfig(), NO_REVIEW)


def test_an_empty_room_with_a_poster_is_nobody():
    room = room_of(*[None] * COUNT, parts=[(POSTER,)] * COUNT)
    assert room.initial_frame is None
    assert room.why_nobody == NOBODY_SEEN


def test_a_mannequin_is_nobody():
    room = room_of(*[(0.0, 0.0)] * COUNT)
    assert room.initial_frame is None
    assert room.why_nobody == NOBODY_SEEN


def test_a_person_whom_the_user_names_is_trusted():
    """Even one who does not move at all, and looks like a mannequin."""
    named = room_of(*[(0.0, 0.0)] * COUNT, config=TrackConfig(patient_xz_m=(0.0, 0.0)))
    assert named.initial_frame is not None


def test_a_person_who_only_sways_is_found_and_the_note_says_how():
    room = room_of(*[(0.006 * np.sin(1.3 * k), 0.0) for k in range(COUNT)])
    assert room.initial_frame.choice.ground_xz_m == pytest.approx((0.0, 0.0), abs=0.2)
    assert HARDLY_MOVES in room.notes


def test_a_person_who_walks_is_found_without_such_a_note():
    room = room_of(*[(0.0, 0.2 * k - 1.1) for k in range(COUNT)])
    assert room.initial_frame is not None
    assert room.notes == ()


def pushed(k: int) -> tuple:
    """A wheelchair, as tall as the trunk of a person who sits in it."""
    z = 0.2 * k - 1.1

    def plate(y: float, size: tuple[float, float, float], x: float = 0.0, aside_m: float = 0.0) -> Box:
        return Box("plate", np.array([x, y, z + aside_m]), np.array(size), np.eye(3))

    wheels = (plate(0.3, (0.6, 0.6, 0.03), aside_m=side) for side in (-0.28, 0.28))
    return (plate(0.5, (0.45, 0.05, 0.5)), plate(0.75, (0.04, 0.5, 0.5), x=-0.25), *wheels)


def test_furniture_that_is_pushed_is_no_patient():
    room = room_of(*[None] * COUNT, parts=[pushed(k) for k in range(COUNT)])
    assert room.initial_frame is None
    assert room.why_nobody in (NOT_A_PERSON, NOBODY_SEEN)


@pytest.mark.slow  # 20 s: everybody in every frame gets bodies, twice
def test_a_person_who_stands_still_beside_furniture_that_is_pushed_is_the_patient():
    room = room_of(
        *[(-0.5 + 0.006 * np.sin(1.3 * k), 1.5) for k in range(COUNT)], parts=[pushed(k) for k in range(COUNT)]
    )
    assert room.initial_frame.choice.ground_xz_m == pytest.approx((-0.5, 1.5), abs=0.25)


def test_legs_alone_are_said_to_be_limbs():
    room = room_of(*[(0.0, 0.1 * k - 0.6) for k in range(COUNT)], camera=LOW)
    assert room.initial_frame is None
    assert room.why_nobody == NoStart.LIMBS_ALONE
