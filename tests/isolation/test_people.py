"""Who is in the room: bodies in a built room, then the shared recordings."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from room_builder import FRONT, KNEE_BAR, ROOM, body, built_scene, camera_at, in_front, picture
from scipy.spatial import cKDTree

from anchorpose.calibration.world import find_world
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.people import IsolationConfig, PatientChoice, find_columns, find_people
from anchorpose.isolation.scene import find_pieces, set_scene
from anchorpose.isolation.separation import separate_initial
from anchorpose.isolation.view import PixelLabel
from anchorpose.recording.equipment import Box, Cylinder
from anchorpose.recording.reader import open_recording, read_frame

DATA = Path(__file__).parents[3] / "shared" / "data"
CONFIG = IsolationConfig()


def test_a_body_behind_a_bar_is_one_person_and_the_bar_none():
    scene = built_scene(KNEE_BAR)
    pieces = [find_pieces(picture(FRONT, *ROOM, KNEE_BAR, *body(0, 0), seed=3), scene)]
    people = find_people(pieces, CONFIG)
    assert len(people.people) == 1
    choice = PatientChoice(np.zeros(2), "", sure=True)
    (view,) = separate_initial(pieces, people, choice)
    shin = in_front(FRONT, *body(0, 0)) & (np.arange(FRONT.height)[:, None] > 150)
    assert view.patient[shin].mean() > 0.9
    assert (view.labels == PixelLabel.EQUIPMENT).sum() > 200


@pytest.mark.parametrize("apart", [0.45, 0.6, 1.0])
def test_two_people_are_two_even_shoulder_to_shoulder(apart):
    scene = built_scene()
    parts = (*body(0.0, -apart / 2), *body(0.0, apart / 2))
    people = find_people([find_pieces(picture(FRONT, *ROOM, *parts, seed=3), scene)], CONFIG)
    assert len(people.people) == 2
    places = sorted(person.ground_xz_m[1] for person in people.people)
    assert places == pytest.approx([-apart / 2, apart / 2], abs=0.08)


def test_a_chest_is_a_faint_person_and_only_where_asked():
    chest = Cylinder("chest", np.array([0.0, 1.4, 0.6]), np.array([0.0, 1.0, 0.0]), 0.08, 0.6)
    pieces = [find_pieces(picture(FRONT, *ROOM, *body(0, -0.4), chest, seed=3), built_scene())]
    assert find_people(pieces, CONFIG).group == (0,)
    both = find_people(pieces, CONFIG, faint=True)
    assert both.group == (0, 1)
    assert both.faint == (1,)
    assert both.people[1].ground_xz_m == pytest.approx((0.05, 0.6), abs=0.1)
    without = find_people(pieces, CONFIG, (0, -1), faint=True)
    assert len(without.people) == 1
    assert np.array_equal(without.of[0], find_people(pieces, CONFIG).of[0])


def test_two_cameras_agree_on_one_person():
    side = camera_at((1.2, 1.3, -2.2), (0.0, 0.9, 0.0))
    pieces = [
        find_pieces(picture(camera, *ROOM, *body(0, 0), seed=3), built_scene(camera=camera)) for camera in (FRONT, side)
    ]
    people = find_people(pieces, CONFIG)
    assert len(people.people) == 1
    assert np.linalg.norm(people.people[0].ground_xz_m) < 0.15


def test_a_board_held_up_is_nobody_and_no_part_of_anybody():
    board = Box("board", np.array([0.5, 1.1, 0.0]), np.array([0.01, 0.5, 0.5]), np.eye(3))
    pieces = find_pieces(picture(FRONT, *ROOM, *body(0, 0), board, seed=3), built_scene())
    on_board = picture(FRONT, *ROOM, *body(0, 0), board) < picture(FRONT, *ROOM, *body(0, 0)) - 1e-3
    assert (pieces.index[on_board] < 0).mean() > 0.97
    assert (pieces.labels[on_board] == PixelLabel.CLUTTER).mean() > 0.9
    people = find_people([pieces], CONFIG)
    assert len(people.people) == 1


def test_nobody_in_an_empty_room():
    assert not find_people([find_pieces(picture(FRONT, *ROOM, seed=3), built_scene())], CONFIG).people


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
        seen = [depth for frame_set in sampled if (depth := frame_set.depths_m[number]) is not None]
        background = opened.backgrounds_m[number] if with_picture else None
        room = learn_background(background, seen, camera, world.floor_height_m, opened.equipment)
        scenes.append(set_scene(camera, room, opened.equipment))
    depths = read_frame(opened, frame).depths_m
    pieces = [None if d is None else find_pieces(d, s) for d, s in zip(depths, scenes, strict=True)]
    return opened, pieces, find_people(pieces, CONFIG)


@pytest.mark.thorough
@pytest.mark.parametrize("with_picture", [True, False])
def test_the_clinics_three_people_are_separated(with_picture):
    _, pieces, people = shared_people("sample_clinic/recording", 0, with_picture)
    assert len(people.people) == 3
    joints = np.load(DATA / "sample_clinic" / "truth" / "truth.npz")["joints"][0]
    choice = PatientChoice(joints[0, [0, 2]], "", sure=True)
    assert min(np.linalg.norm(person.ground_xz_m - choice.ground_xz_m) for person in people.people) < 0.2
    for piece, view in zip(pieces, separate_initial(pieces, people, choice), strict=True):
        seen = piece.points_m[view.patient[piece.row, piece.column]]
        distance, _ = cKDTree(joints).query(seen)
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
    found = []
    for with_picture in (True, False):
        _, (pieces,), people = shared_people("iit_rehab_room", 150, with_picture)
        mask = np.zeros(pieces.depth_m.shape, bool)
        mask[pieces.row, pieces.column] = people.of[0] >= 0
        found.append(mask)
    assert (found[0] & found[1]).sum() > 0.75 * (found[0] | found[1]).sum()


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


def test_what_hangs_over_a_head_is_no_part_of_the_person():
    lamp = Box("lamp", np.array([0.0, 2.3, 0.0]), np.array([0.3, 0.02, 0.3]), np.eye(3))
    seated = Cylinder("seated", np.array([0.0, 0.6, 0.0]), np.array([0.0, 1.0, 0.0]), 0.18, 1.2)
    high = camera_at((2.5, 1.4, 0.0), (0.0, 1.4, 0.0))
    pieces = find_pieces(picture(high, *ROOM, seated, lamp, seed=3), built_scene(camera=high))
    assert (pieces.points_m[:, 1] > 2.0).sum() > 50
    people = find_people([pieces], CONFIG)
    assert people.people[0].top_m == pytest.approx(1.2, abs=0.1)
    assert (people.of[0][pieces.points_m[:, 1] > 2.25] == -1).mean() > 0.95


@pytest.mark.thorough
def test_a_floor_full_of_mass_is_searched_in_seconds():
    points = np.random.default_rng(4).uniform(0.0, [25.0, 2.0, 25.0], (62_500, 3)).astype(np.float32)
    start = time.process_time()
    people = find_columns(points, np.full(len(points), 0.01, np.float32))
    assert time.process_time() - start < 15.0  # 5; a minute and more where each peak looked at all points and peaks
    assert len(people) > 1000
