"""Empty rooms, posters, pushed furniture and legs alone are nobody; a patient who keeps still is found."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from room_builder import FRONT, ROOM, body, camera_at, picture, seated

from anchorpose.camera import Camera
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.people import PatientChoice, Person
from anchorpose.isolation.room_planes import find_walls
from anchorpose.isolation.scene import Scene, find_pieces, set_scene
from anchorpose.recording.equipment import Box
from anchorpose.recording.recording import FrameSet, Subject
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.look import find_mirrors, through_a_gap, with_mirrors
from anchorpose.tracker.preparation import Settled, furnish_room
from anchorpose.tracker.room import NO_REVIEW, NOBODY_SEEN, Room, Run
from anchorpose.tracker.sighting import SeenPerson, Sighting, sight_people
from anchorpose.tracker.start import NoStart, find_start

COUNT = 8
LOW = camera_at((1.3, 0.55, 0.0), (0.0, 0.1, 0.0))  # sees less than 0.8 m of a person who stands 1.3 m away
POSTER = Box("poster", np.array([-1.98, 1.3, 0.7]), np.array([0.02, 0.9, 0.7]), np.eye(3))


def room_of(*moments, camera: Camera = FRONT) -> Room:
    """What is known of a recording of which the camera has no picture of the empty room; moments: parts per frame."""
    frames = [
        FrameSet(frame=k, time_s=k / 5, depths_m=(picture(camera, *ROOM, *parts, seed=k),))
        for k, parts in enumerate(moments)
    ]
    recording = SimpleNamespace(backgrounds_m=(None,), equipment=None, subject=Subject())
    calibration = SimpleNamespace(cameras=(camera,), floor_height_m=0.0)
    settled = Settled(recording, None, calibration, tuple(range(len(frames))), tuple(frames))
    return furnish_room(settled, TrackConfig(), NO_REVIEW)


def test_an_empty_room_with_a_poster_is_nobody():
    room = room_of(*[(POSTER,)] * COUNT)
    assert room.initial_frame is None
    assert room.why_nobody == NOBODY_SEEN


@pytest.mark.parametrize(
    "moments",
    [[body(0.0, 0.0)] * COUNT, [seated(0.0, 0.0)] * COUNT, [body(0.0, 0.2 * k - 0.8) for k in range(COUNT)]],
    ids=["stands still", "sits still", "walks"],
)
def test_a_person_is_found_who_keeps_still_and_who_walks(moments):
    room = room_of(*moments)
    assert room.initial_frame.choice.ground_xz_m[0] == pytest.approx(0.0, abs=0.1)
    assert room.notes == ()


def pushed(k: int) -> tuple:
    """A wheelchair, as tall as the trunk of a person who sits in it."""
    z = 0.2 * k - 1.1

    def plate(y: float, size: tuple[float, float, float], x: float = 0.0, aside_m: float = 0.0) -> Box:
        return Box("plate", np.array([x, y, z + aside_m]), np.array(size), np.eye(3))

    wheels = (plate(0.3, (0.6, 0.6, 0.03), aside_m=side) for side in (-0.28, 0.28))
    return (plate(0.5, (0.45, 0.05, 0.5)), plate(0.75, (0.04, 0.5, 0.5), x=-0.25), *wheels)


@pytest.mark.thorough
def test_furniture_that_is_pushed_is_no_patient():
    room = room_of(*[pushed(k) for k in range(COUNT)])
    assert room.initial_frame is None
    assert room.why_nobody == NOBODY_SEEN


def test_a_person_who_stands_still_beside_furniture_that_is_pushed_is_the_patient():
    room = room_of(*[(*body(-0.5, 1.5), *pushed(k)) for k in range(COUNT)])
    assert room.initial_frame.choice.ground_xz_m == pytest.approx((-0.5, 1.5), abs=0.15)


@pytest.mark.thorough
def test_legs_alone_are_said_to_be_limbs():
    moments = [body(0.0, 0.2 * k - 0.6) for k in range(4)]
    first = FrameSet(frame=0, time_s=0.0, depths_m=(picture(LOW, *ROOM, *moments[0], seed=0),))
    room = room_of(*moments, camera=LOW)
    assert find_start(first, Run(room, TrackConfig()), room.initial_frame.choice, None) == NoStart.LIMBS_ALONE


WALL_M = -1.2  # x of the front of the wall; the descriptor does not find images that are 6 m away
MIRRORED = (ROOM[0], Box("wall", np.array([WALL_M - 0.05, 1.5, 0.0]), np.array([0.1, 3.0, 12.0]), np.eye(3)))
GLASS = Box("glass", np.array([WALL_M + 0.001, 1.1, 0.2]), np.array([0.002, 1.7, 2.0]), np.eye(3))
FARTHER = (
    Box("floor", np.array([0.0, -0.05, 0.0]), np.array([20.0, 0.1, 12.0]), np.eye(3)),
    Box("wall", np.array([-4.4, 1.5, 0.0]), np.array([0.1, 3.0, 12.0]), np.eye(3)),
)
WALK = [(0.1 * k - 0.1, 0.25 * k - 0.9) for k in range(9)]  # x, z
IN_GLASS = picture(FRONT, *MIRRORED, GLASS) < picture(FRONT, *MIRRORED) - 5e-4


def seen(here, there, seed: int) -> np.ndarray:
    """(height, width) depth with a person at ``here`` in the room and one at ``there`` beyond the glass, or None."""
    before = picture(FRONT, *MIRRORED, *(body(*here) if here else ()), seed=seed)
    beyond = picture(FRONT, *FARTHER, *(body(*there, heading_deg=180.0) if there else ()), seed=100 + seed)
    through = IN_GLASS & (before > picture(FRONT, *MIRRORED) - 0.1)
    return np.where(through, beyond, before)


def mirrored(place) -> tuple[float, float]:
    return 2.0 * WALL_M - place[0], place[1]


@cache
def scene() -> Scene:
    frames = [seen(place, mirrored(place), k) for k, place in enumerate(WALK)]
    return set_scene(FRONT, learn_background(None, frames, FRONT, 0.0), None)


def sightings(here, there) -> list[Sighting]:
    """Where people are on both sides of the wall, frame by frame, without pixels."""

    def people(*places) -> tuple[SeenPerson, ...]:
        return tuple(SeenPerson(Person(np.array(p), 0.0, 1.7, 0.4), None) for p in places if p)

    places = zip(here, there, strict=True)
    return [Sighting(k, people(*two), (seen(*two, seed=k),)) for k, two in enumerate(places)]


def test_the_wall_has_one_gap_which_is_the_glass():
    wall = find_walls(scene())[0]
    assert wall.offset_m == pytest.approx(-WALL_M, abs=0.02)
    assert (wall.gap & IN_GLASS).sum() > 0.97 * IN_GLASS.sum()
    assert (wall.gap & ~IN_GLASS).sum() < 0.05 * IN_GLASS.sum()


@pytest.mark.thorough
def test_a_mirror_image_is_nobody_in_any_frame():
    frames = [FrameSet(frame=k, time_s=k / 5, depths_m=(seen(p, mirrored(p), 50 + k),)) for k, p in enumerate(WALK)]
    found = [sight_people(frame, (scene(),)) for frame in frames]
    both = sum(len(one.people) == 2 for one in found)
    assert both >= 3, "the image is taken for a person at first, unless the person hides it"
    (mirror,) = find_mirrors(found, (scene(),), None)
    assert (mirror.twins, mirror.shown) == (both, both)
    assert "a mirror was found 3.7 m from camera front" in mirror.sentence
    (walled,) = with_mirrors((scene(),), [mirror])
    for frame, place in zip(frames, WALK, strict=True):
        (person,) = sight_people(frame, (walled,)).people
        assert person.place_xz_m == pytest.approx(place, abs=0.1)


def test_who_is_out_of_view_does_not_make_the_image_a_person():
    """A mirror was seen to be one; an image without its person has no pixels either."""
    (mirror,) = find_mirrors(sightings(WALK, map(mirrored, WALK)), (scene(),), None)
    (walled,) = with_mirrors((scene(),), [mirror])
    image = seen(None, (-2.6, 0.3), 7)
    assert len(find_pieces(image, scene()).row) > 400
    assert len(find_pieces(image, walled).row) < 20


@pytest.mark.parametrize(
    "here",
    [[None] * 9, [(0.0, -0.8)] * 9, [(x, -z) for x, z in WALK], WALK[:2] + [(1.0, -1.0)] * 7],
    ids=["nobody", "one who stands", "one who walks the other way", "one who is like an image twice"],
)
def test_somebody_in_the_next_room_is_no_image(here):
    assert not find_mirrors(sightings(here, map(mirrored, WALK)), (scene(),), None)


def test_two_people_in_one_room_are_no_images():
    two = sightings(WALK, [(0.5, 1.2)] * 9)
    assert not find_mirrors(two, (scene(),), None)


def test_the_user_may_name_somebody_beyond_a_wall():
    both = sightings(WALK, map(mirrored, WALK))
    assert not find_mirrors(both, (scene(),), (-2.6, 0.0))
    assert find_mirrors(both, (scene(),), (0.0, 0.0))


@pytest.mark.parametrize(("place", "said"), [((-2.6, 0.3), True), ((-1.0, 0.3), False)])
def test_a_patient_who_is_seen_through_a_gap_is_said_to_be(place, said):
    alone = sightings([None], [place])
    choice = PatientChoice(np.array(place), "", sure=False, frame=0)
    sentence = through_a_gap(choice, alone, (scene(),))
    assert (sentence is not None) == said
    assert not said or "a doorway or a window, or a mirror" in sentence
