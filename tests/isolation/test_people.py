"""Who is in the room: people in a built room, then the shared recordings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from room_builder import FRONT, KNEE_BAR, ROOM, body, built_scene, camera_at, in_front, picture, seated
from scipy.spatial import cKDTree

from anchorpose.calibration.world import find_world
from anchorpose.descriptor.people import LEAST_AREA_M2, find_people
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.people import PatientChoice, People, see_people
from anchorpose.isolation.scene import Pieces, find_pieces, set_scene
from anchorpose.isolation.separation import separate_initial
from anchorpose.isolation.view import PixelLabel
from anchorpose.recording.equipment import Box
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.tracker.sighting import see_people_apart

DATA = Path(__file__).parents[3] / "shared" / "data"
SIDE = camera_at((1.2, 1.3, -2.2), (0.0, 0.9, 0.0))


def seen(*parts, cameras=(FRONT,), equipment=()) -> tuple[list[Pieces], People]:
    """The foreground of people and things in a room of which there is a picture, and who is seen in it."""
    images = [picture(camera, *ROOM, *equipment, *parts, seed=3) for camera in cameras]
    scenes = [built_scene(*equipment, camera=camera) for camera in cameras]
    pieces = [find_pieces(image, scene) for image, scene in zip(images, scenes, strict=True)]
    return pieces, see_people(pieces, cameras)


def mask_of(pieces: Pieces, chosen: np.ndarray) -> np.ndarray:
    mask = np.zeros(pieces.depth_m.shape, bool)
    mask[pieces.row[chosen], pieces.column[chosen]] = True
    return mask


def test_a_body_behind_a_bar_is_one_person_and_the_bar_none():
    pieces, people = seen(*body(0, 0), equipment=(KNEE_BAR,))
    assert len(people.people) == 1
    (view,) = separate_initial(pieces, people, PatientChoice(np.zeros(2), "", sure=True))
    shin = in_front(FRONT, *body(0, 0)) & (np.arange(FRONT.height)[:, None] > 150)
    assert view.patient[shin].mean() > 0.9
    assert (view.labels == PixelLabel.EQUIPMENT).sum() > 200


@pytest.mark.parametrize("heading_deg", [0.0, 180.0])
@pytest.mark.parametrize(("ahead", "apart"), [(0.2, 0.45), (0.0, 0.55), (0.0, 1.0)])
def test_two_people_are_two_even_shoulder_to_shoulder(ahead, apart, heading_deg):
    first, second = body(0.0, -apart / 2), body(ahead, apart / 2, heading_deg=heading_deg)
    (pieces,), people = seen(*first, *second)
    assert len(people.people) == 2
    places = sorted(person.ground_xz_m[1] for person in people.people)
    assert places == pytest.approx([-apart / 2, apart / 2], abs=0.08)
    by_place = np.argsort([person.ground_xz_m[1] for person in people.people])
    for one, true in zip(by_place, (in_front(FRONT, *first), in_front(FRONT, *second)), strict=True):
        assert true[mask_of(pieces, people.of[0] == one)].mean() > 0.97


def test_a_child_beside_an_adult_is_a_person():
    _, people = seen(*body(0.0, -0.4), *body(0.0, 0.4, 1.1))
    assert len(people.people) == 2
    adult, child = sorted(people.people, key=lambda one: -one.top_m)
    assert (adult.ground_xz_m[1], child.ground_xz_m[1]) == pytest.approx((-0.4, 0.4), abs=0.08)
    assert child.top_m == pytest.approx(1.1, abs=0.1)


@pytest.mark.parametrize("places", [[(0.0, 0.0)], [(0.1, -0.4), (-0.3, 0.5)]], ids=["one", "two"])
def test_two_cameras_agree_on_who_is_there(places):
    pieces, people = seen(*(part for place in places for part in body(*place)), cameras=(FRONT, SIDE))
    assert len(people.people) == len(places)
    found = sorted((person.ground_xz_m for person in people.people), key=lambda place: place[1])
    np.testing.assert_allclose(found, places, atol=0.08)
    assert {int(one) for of in people.of for one in of} == set(range(-1, len(places)))
    for shown, of in zip(pieces, people.of, strict=True):
        assert (of >= 0).mean() > 0.85  # without the outlines
        for number, person in enumerate(people.people):
            away = shown.points_m[of == number][:, [0, 2]] - person.ground_xz_m
            assert np.quantile(np.linalg.norm(away, axis=1), 0.99) < 0.4


def test_a_board_held_up_is_nobody_and_no_part_of_anybody():
    board = Box("board", np.array([0.5, 1.1, 0.0]), np.array([0.01, 0.5, 0.5]), np.eye(3))
    (pieces,), people = seen(*body(0, 0), board)
    on_board = picture(FRONT, *ROOM, *body(0, 0), board) < picture(FRONT, *ROOM, *body(0, 0)) - 1e-3
    assert (pieces.index[on_board] < 0).mean() > 0.97
    assert (pieces.labels[on_board] == PixelLabel.CLUTTER).mean() > 0.9
    assert len(people.people) == 1


def test_nobody_in_an_empty_room():
    assert not seen()[1].people


def test_what_hangs_over_a_head_is_no_part_of_the_person():
    lamp = Box("lamp", np.array([0.0, 1.6, 0.0]), np.array([0.3, 0.02, 0.3]), np.eye(3))
    (pieces,), people = seen(*seated(0.0, 0.0), lamp)
    on_lamp = pieces.points_m[:, 1] > 1.55
    assert on_lamp.sum() > 50
    assert people.people[0].top_m == pytest.approx(1.3, abs=0.1)
    assert (people.of[0][on_lamp] == -1).mean() > 0.95


def shared_people(name: str, frame: int, with_picture: bool = True):
    if not (DATA / name).exists():
        pytest.skip(f"{DATA / name} is absent: the shared recordings are not part of this project")
    opened = open_recording(DATA / name)
    last = len(opened.streams[0].files) - 1
    sampled = [
        read_frame(opened, int(k)) for k in np.unique(np.linspace(0, last, 16 if with_picture else 48).astype(int))
    ]
    world = find_world(opened, sampled)
    scenes = []
    for number, camera in enumerate(world.cameras):
        frames = [depth for frame_set in sampled if (depth := frame_set.depths_m[number]) is not None]
        background = opened.backgrounds_m[number] if with_picture else None
        room = learn_background(background, frames, camera, world.floor_height_m, opened.equipment)
        scenes.append(set_scene(camera, room, opened.equipment))
    depths = read_frame(opened, frame).depths_m
    pieces = [None if d is None else find_pieces(d, s) for d, s in zip(depths, scenes, strict=True)]
    return opened, pieces, see_people_apart(pieces, world.cameras).people


@pytest.mark.thorough
@pytest.mark.parametrize("with_picture", [True, False])
def test_the_clinics_three_people_are_separated(with_picture):
    _, pieces, people = shared_people("sample_clinic/recording", 0, with_picture)
    assert len(people.people) == 3
    joints = np.load(DATA / "sample_clinic" / "truth" / "truth.npz")["joints"][0]
    choice = PatientChoice(joints[0, [0, 2]], "", sure=True)
    assert min(np.linalg.norm(person.ground_xz_m - choice.ground_xz_m) for person in people.people) < 0.2
    for piece, view in zip(pieces, separate_initial(pieces, people, choice), strict=True):
        on_patient = piece.points_m[view.patient[piece.row, piece.column]]
        distance, _ = cKDTree(joints).query(on_patient)
        assert np.mean(distance > 0.35) < 0.03  # nobody else's limbs


def test_five_people_in_a_corridor_are_separated():
    """The two in the middle stand 0.4 m apart, shoulder behind shoulder."""
    _, _, people = shared_people("five_people", 0)
    assert len(people.people) == 5


@pytest.mark.thorough
@pytest.mark.parametrize("with_picture", [True, False])
def test_the_visitor_of_the_rehabilitation_room_is_one_person(with_picture):
    assert len(shared_people("iit_rehab_room", 150, with_picture)[2].people) == 1
    assert len(shared_people("iit_rehab_room", 0, with_picture)[2].people) == 0


@pytest.mark.thorough
def test_the_visitors_pixels_are_the_same_without_a_picture_of_the_empty_room():
    one, other = (
        mask_of(pieces, people.of[0] >= 0)
        for _, (pieces,), people in (shared_people("iit_rehab_room", 150, way) for way in (True, False))
    )
    assert (one & other).sum() > 0.75 * (one | other).sum()


def test_the_board_is_apart_from_the_man_who_holds_it():
    """It hides the trunk; the legs below it and the head above it are one person, the board is not one."""
    _, (pieces,), people = shared_people("realsense_board", 1)
    owner = np.full(pieces.depth_m.shape, -1)
    owner[pieces.row, pieces.column] = people.of[0]
    board, legs = owner[45:195, 160:240], owner[230:330, 185:225]
    assert (pieces.depth_m[45:195, 160:240] > 0).mean() > 0.9
    assert (board < 0).mean() > 0.99
    man = np.bincount(legs[legs >= 0]).argmax()
    assert (legs == man).mean() > 0.6
    assert (owner[:22, 160:240] == man).sum() > 200


@pytest.mark.parametrize(("share", "kept"), [(1.0, True), (5.0, False)])
def test_a_person_keeps_few_foreground_pixels_unless_most_of_their_surface_is_the_room(monkeypatch, share, kept):
    """Rays at outlines have no foreground pixels of their depth, so the descriptor's area is the larger one."""
    pieces, _ = seen(*body(0, 0))

    def head_apart(*given):
        (one,) = find_people(*given)
        (own,) = one.rays
        rows = np.arange(own.shape[0])[:, None]
        head = own & (rows < np.flatnonzero(own.any(axis=1))[0] + 4)
        return (
            replace(one, rays=(own & ~head,)),
            replace(one, rays=(head,), area_m2=share * one.area_m2 * head.sum() / own.sum()),
        )

    monkeypatch.setattr("anchorpose.isolation.people.find_people", head_apart)
    people = see_people(pieces, (FRONT,))
    assert len(people.people) == 1 + kept
    assert ((people.of[0] == 1).sum() > 20) == kept
    if kept:
        assert 0.0 < people.people[1].area_m2 < LEAST_AREA_M2
