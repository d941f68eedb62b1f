"""Background, equipment and persons apart: built rooms with known answers, then the shared recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from room_builder import FRONT, KNEE_BAR, NOISE_PER_M, ROOM, body, camera_at, picture
from scipy.ndimage import label as label_mask
from scipy.spatial import cKDTree

from anchorpose.calibration.floor import FloorConfig
from anchorpose.calibration.world import find_world
from anchorpose.camera import transform_points
from anchorpose.isolation.background import BackgroundSource, foreground, learn_background
from anchorpose.isolation.components import label_components, without_flying_pixels
from anchorpose.isolation.config import IsolationConfig
from anchorpose.isolation.equipment import equipment_mask, hidden_by_equipment, view_equipment
from anchorpose.isolation.near_skin import VOXEL_M, distance_field, thinned
from anchorpose.isolation.patient import isolate, isolate_at_start, other_people
from anchorpose.isolation.people import choose_patient, find_people
from anchorpose.isolation.scene import find_pieces, set_scene
from anchorpose.isolation.view import PixelLabel
from anchorpose.recording.equipment import Box, EquipmentModel
from anchorpose.recording.reader import open_recording, read_frames

DATA = Path(__file__).parents[2] / "shared" / "data"
CONFIG = IsolationConfig()
EMPTY = picture(FRONT, *ROOM, seed=0)
EMPTY_FRAMES = [picture(FRONT, *ROOM, seed=k) for k in range(1, 5)]


def truth(camera, *parts) -> np.ndarray:
    """(height, width) bool: pixels where the parts are in front of the room."""
    return picture(camera, *ROOM, *parts) < picture(camera, *ROOM) - 1e-3


def built_scene(*equipment, camera=FRONT):
    model = learn_background(picture(camera, *ROOM, *equipment, seed=0), [picture(camera, *ROOM, *equipment, seed=k)
                             for k in range(1, 5)], camera, 0.0, CONFIG)  # fmt: skip
    return set_scene(camera, model, EquipmentModel(equipment) if equipment else None)


def test_nobody_is_foreground_in_an_empty_room():
    model = learn_background(EMPTY, EMPTY_FRAMES, FRONT, 0.0, CONFIG)
    assert model.source == BackgroundSource.PICTURE
    assert foreground(picture(FRONT, *ROOM, seed=9), model, CONFIG).mean() < 1e-3


def test_a_body_is_foreground_down_to_its_soles():
    model = learn_background(EMPTY, EMPTY_FRAMES, FRONT, 0.0, CONFIG)
    depth, expected = picture(FRONT, *ROOM, *body(0, 0), seed=9), truth(FRONT, *body(0, 0))
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
    depth, expected = picture(FRONT, *ROOM, *body(0, 0), seed=9), truth(FRONT, *body(0, 0))
    assert (foreground(depth, model, CONFIG) & expected).sum() > 0.97 * expected.sum()


def test_without_a_picture_a_body_that_walks_by_leaves_the_room_as_background():
    walk = [picture(FRONT, *ROOM, *body(0.0, z), seed=k) for k, z in enumerate(np.linspace(-1.5, 1.5, 12))]
    model = learn_background(None, walk, FRONT, 0.0, CONFIG)
    assert model.source == BackgroundSource.RECORDING
    expected = truth(FRONT, *body(0.0, 0.0))
    found = foreground(picture(FRONT, *ROOM, *body(0.0, 0.0), seed=20), model, CONFIG)
    assert (found & expected).sum() > 0.95 * expected.sum()


def test_without_a_picture_a_patient_who_sways_in_place_is_no_background():
    sway = [picture(FRONT, *ROOM, *body(0.0, 0.04 * np.sin(k)), seed=k) for k in range(12)]
    model = learn_background(None, sway, FRONT, 0.0, CONFIG)
    expected = truth(FRONT, *body(0.0, 0.0))
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


def test_flying_pixels_are_left_out_and_surfaces_stay():
    depth = np.full((20, 20), 2.0, np.float32)
    depth[:, 10:] = 3.0
    depth[5, 9] = 2.5
    kept = without_flying_pixels(depth, depth > 0, np.full(depth.shape, 0.05, np.float32))
    assert not kept[5, 9]
    assert kept.sum() == depth.size - 1


def test_pieces_are_those_of_scipy_where_nothing_jumps():
    mask = np.random.default_rng(1).random((60, 80)) < 0.45
    flat = np.full(mask.shape, 2.0, np.float32)
    labels, count = label_components(flat, mask, np.full(mask.shape, 0.05, np.float32))
    expected, expected_count = label_mask(mask, np.ones((3, 3)))
    assert count == expected_count
    pairs = {(a, b) for a, b in zip(labels[mask], expected[mask], strict=True)}
    assert len(pairs) == count


def test_a_depth_jump_cuts_a_piece():
    depth = np.full((10, 10), 2.0, np.float32)
    depth[:, 5:] = 2.2
    _, count = label_components(depth, depth > 0, np.full(depth.shape, 0.1, np.float32))
    assert count == 2


def test_the_expected_depth_of_equipment_lies_on_its_surface():
    bars = EquipmentModel((KNEE_BAR, *body(0.1, 0.5)))
    view = view_equipment(FRONT, FRONT.pixel_rays(), bars)
    hit = view.depth_m > 0
    points = transform_points(FRONT.T_world_camera, FRONT.back_project(view.depth_m)[hit].astype(np.float64))
    assert hit.sum() > 500
    assert np.abs(bars.distance_m(points)).max() < 2e-3


def test_the_bar_is_equipment_and_the_hand_before_it_is_not():
    bars = EquipmentModel((KNEE_BAR,))
    hand = Box("hand", np.array([0.36, 0.5, 0.1]), np.array([0.04, 0.2, 0.1]), np.eye(3))
    depth = picture(FRONT, *ROOM, KNEE_BAR, hand, seed=3)
    view = view_equipment(FRONT, FRONT.pixel_rays(), bars)
    mask = equipment_mask(depth, view, NOISE_PER_M, CONFIG)
    on_hand = picture(FRONT, *ROOM, KNEE_BAR, hand) < picture(FRONT, *ROOM, KNEE_BAR) - 1e-3
    on_bar = (view.depth_m > 0) & ~on_hand
    assert mask[on_bar].mean() > 0.98
    assert mask[on_hand].mean() < 0.1
    hidden = hidden_by_equipment(depth, view, NOISE_PER_M, CONFIG)
    assert hidden[on_bar].mean() > 0.98
    assert hidden[on_hand].mean() < 0.1


def test_a_bar_that_gives_no_reading_still_hides():
    view = view_equipment(FRONT, FRONT.pixel_rays(), EquipmentModel((KNEE_BAR,)))
    lost = np.where(view.depth_m > 0, 0, picture(FRONT, *ROOM)).astype(np.float32)
    assert equipment_mask(lost, view, NOISE_PER_M, CONFIG)[view.depth_m > 0].all()
    assert hidden_by_equipment(lost, view, NOISE_PER_M, CONFIG)[view.depth_m > 0].all()


def test_a_body_behind_a_bar_is_one_person_and_the_bar_none():
    scene = built_scene(KNEE_BAR)
    pieces = [find_pieces(picture(FRONT, *ROOM, KNEE_BAR, *body(0, 0), seed=3), scene, CONFIG)]
    people = find_people(pieces, CONFIG)
    assert len(people.people) == 1
    choice = choose_patient([people], None, None, np.zeros(2), CONFIG)
    (view,) = isolate_at_start(pieces, people, choice)
    shin = truth(FRONT, *body(0, 0)) & (np.arange(FRONT.height)[:, None] > 150)
    assert view.patient[shin].mean() > 0.9
    assert (view.labels == PixelLabel.EQUIPMENT).sum() > 200


@pytest.mark.parametrize("apart", [0.45, 0.6, 1.0])
def test_two_people_are_two_even_shoulder_to_shoulder(apart):
    scene = built_scene()
    parts = (*body(0.0, -apart / 2), *body(0.0, apart / 2))
    people = find_people([find_pieces(picture(FRONT, *ROOM, *parts, seed=3), scene, CONFIG)], CONFIG)
    assert len(people.people) == 2
    places = sorted(person.ground_xz_m[1] for person in people.people)
    assert places == pytest.approx([-apart / 2, apart / 2], abs=0.08)


def test_two_cameras_agree_on_one_person():
    side = camera_at((1.2, 1.3, -2.2), (0.0, 0.9, 0.0))
    pieces = [
        find_pieces(picture(camera, *ROOM, *body(0, 0), seed=3), built_scene(camera=camera), CONFIG)
        for camera in (FRONT, side)
    ]
    people = find_people(pieces, CONFIG)
    assert len(people.people) == 1
    assert np.linalg.norm(people.people[0].ground_xz_m) < 0.15


def choose(*places, equipment=None, patient_xz=None):
    parts = [part for place in places for part in body(*place)]
    people = find_people([find_pieces(picture(FRONT, *ROOM, *parts, seed=3), built_scene(), CONFIG)], CONFIG)
    return choose_patient([people], equipment, patient_xz, np.zeros(2), CONFIG)


def test_the_patient_is_who_the_user_says():
    choice = choose((0.0, 0.0), (0.1, 0.9), patient_xz=(0.0, 0.8))
    assert choice.ground_xz_m[1] > 0.7
    assert "given" in choice.reason


def test_the_patient_is_who_stands_in_the_equipment():
    frame = EquipmentModel((Box("rails", np.array([0.0, 0.5, 0.9]), np.array([0.8, 0.05, 0.8]), np.eye(3)),))
    choice = choose((0.0, 0.0), (0.0, 0.9), equipment=frame)
    assert choice.ground_xz_m[1] > 0.7
    assert "within the equipment" in choice.reason


def test_otherwise_the_patient_is_in_the_middle_and_the_reason_counts_the_others():
    choice = choose((0.0, 0.0), (0.1, 0.9), (0.2, -0.8))
    assert abs(choice.ground_xz_m[1]) < 0.1
    assert "of 3 people" in choice.reason


def test_nobody_in_the_room_is_nobody_chosen():
    assert choose() is None


def test_the_distance_field_is_that_of_a_tree_within_a_voxel():
    rng = np.random.default_rng(2)
    skin, asked = rng.uniform(0, 0.5, (300, 3)), rng.uniform(-0.3, 0.8, (3000, 3))
    field = distance_field(skin, 0.08)
    expected, _ = cKDTree(skin).query(asked)
    found = field.at(asked)
    near, far = expected < 0.08 - VOXEL_M, expected > 0.08 + VOXEL_M
    assert np.abs(found[near] - expected[near]).max() <= VOXEL_M * np.sqrt(3) / 2 + 1e-6
    assert np.isinf(found[far]).all()


def test_thinning_leaves_one_point_a_cube():
    points = np.array([[0, 0, 0], [0.01, 0, 0], [0.2, 0, 0]], np.float32)
    assert thinned(points, 0.05) == pytest.approx(points[[0, 2]])


def test_a_helper_who_touches_the_patient_stays_apart_when_the_skin_is_known():
    scene = built_scene()
    patient, helper = body(0, 0), body(0.05, 0.6)
    arm = Box("arm", np.array([0.05, 1.1, 0.3]), np.array([0.08, 0.08, 0.4]), np.eye(3))
    apart = [find_pieces(picture(FRONT, *ROOM, *patient, *helper, seed=3), scene, CONFIG)]
    people = find_people(apart, CONFIG)
    choice = choose_patient([people], None, (0.0, 0.0), np.zeros(2), CONFIG)
    first = isolate_at_start(apart, people, choice)
    skin = apart[0].points_m[first[0].patient[apart[0].row, apart[0].column]][::3]
    touching = picture(FRONT, *ROOM, *patient, *helper, arm, seed=4)
    pieces = [find_pieces(touching, scene, CONFIG)]
    (view,) = isolate(pieces, skin, other_people(apart, first, CONFIG), CONFIG)
    assert view.patient[truth(FRONT, *patient) & ~truth(FRONT, *helper, arm)].mean() > 0.95
    assert (view.labels == PixelLabel.OTHER_PERSON)[truth(FRONT, *helper) & ~truth(FRONT, *patient)].mean() > 0.95
    assert view.patient[truth(FRONT, arm)].mean() < 0.5


def test_a_helpers_hand_just_above_the_skin_stays_the_helpers():
    scene = built_scene()
    alone = find_pieces(picture(FRONT, *ROOM, *body(0, 0), seed=3), scene, CONFIG)
    hand = Box("hand", np.array([0.21, 1.0, 0.0]), np.array([0.02, 0.12, 0.12]), np.eye(3))  # its face 6 cm off
    pieces = find_pieces(picture(FRONT, *ROOM, *body(0, 0), hand, seed=4), scene, CONFIG)
    on_hand = truth(FRONT, *body(0, 0), hand) & (picture(FRONT, *body(0, 0), hand) < picture(FRONT, *body(0, 0)) - 1e-3)
    hand_m = pieces.points_m[on_hand[pieces.row, pieces.column]]
    (view,) = isolate([pieces], alone.points_m[::3], hand_m, CONFIG)
    assert view.patient[on_hand].mean() < 0.2
    (unaware,) = isolate([pieces], alone.points_m[::3], hand_m[:0], CONFIG)
    assert unaware.patient[on_hand].mean() > 0.8  # nothing else tells a hand this near from the patient


def test_an_arm_that_outran_its_prediction_is_kept_while_nobody_is_near():
    scene = built_scene()
    skin_pieces = [find_pieces(picture(FRONT, *ROOM, *body(0, 0), seed=3), scene, CONFIG)]
    skin = skin_pieces[0].points_m[::3]
    arm = Box("arm", np.array([0.1, 1.2, 0.35]), np.array([0.08, 0.08, 0.5]), np.eye(3))
    pieces = [find_pieces(picture(FRONT, *ROOM, *body(0, 0), arm, seed=4), scene, CONFIG)]
    (view,) = isolate(pieces, skin, np.empty((0, 3), np.float32), CONFIG)
    assert view.patient[truth(FRONT, arm)].mean() > 0.9


def test_a_missing_picture_stays_missing():
    pieces = [find_pieces(picture(FRONT, *ROOM, *body(0, 0), seed=3), built_scene(), CONFIG), None]
    people = find_people(pieces, CONFIG)
    choice = choose_patient([people], None, None, np.zeros(2), CONFIG)
    assert isolate_at_start(pieces, people, choice)[1] is None
    assert isolate(pieces, pieces[0].points_m, np.empty((0, 3)), CONFIG)[1] is None


def test_input_that_cannot_be_used_is_refused():
    with pytest.raises(ValueError, match="at least one frame"):
        learn_background(EMPTY, [], FRONT, 0.0, CONFIG)
    with pytest.raises(ValueError, match="skin_margin_m"):
        IsolationConfig(skin_margin_m=-1)
    with pytest.raises(ValueError, match="right angle"):
        IsolationConfig(steepest_slope_rad=1.6)


def shared_people(name: str, frame: int, with_picture: bool = True):
    if not (DATA / name).exists():
        pytest.skip(f"{DATA / name} is absent: the shared recordings are not part of this project")
    opened = open_recording(DATA / name)
    last = len(opened.streams[0].files) - 1
    sampled = [
        next(iter(read_frames(opened, int(k), int(k) + 1))) for k in np.unique(np.linspace(0, last, 12).astype(int))
    ]
    world = find_world(opened, sampled, FloorConfig())
    scenes = [
        set_scene(camera, learn_background(
            opened.backgrounds_m[number] if with_picture else None,
            [depth for s in sampled if (depth := s.depths_m[number]) is not None], camera, world.floor_height_m, CONFIG,
        ), opened.equipment)
        for number, camera in enumerate(world.cameras)
    ]  # fmt: skip
    depths = next(iter(read_frames(opened, frame, frame + 1))).depths_m
    pieces = [None if d is None else find_pieces(d, s, CONFIG) for d, s in zip(depths, scenes, strict=True)]
    return opened, pieces, find_people(pieces, CONFIG)


@pytest.mark.parametrize("with_picture", [True, False])
def test_the_clinics_patient_is_found_among_three_people(with_picture):
    opened, pieces, people = shared_people("sample_clinic/recording", 0, with_picture)
    assert len(people.people) == 3
    choice = choose_patient([people], opened.equipment, None, np.zeros(2), CONFIG)
    pelvis = np.load(DATA / "sample_clinic" / "truth" / "truth.npz")["joints"][0, 0, [0, 2]]
    assert np.linalg.norm(choice.ground_xz_m - pelvis) < 0.2
    assert choice.reason == "stands within the equipment, of 3 people"
    joints = np.load(DATA / "sample_clinic" / "truth" / "truth.npz")["joints"][0]
    for piece, view in zip(pieces, isolate_at_start(pieces, people, choice), strict=True):
        seen = piece.points_m[view.patient[piece.row, piece.column]]
        distance, _ = cKDTree(joints).query(seen)
        assert np.mean(distance > 0.35) < 0.03  # nobody else's limbs


def test_at_least_four_of_five_people_in_a_corridor_are_told_apart():
    """The two in the middle stand 0.4 m apart, shoulder behind shoulder."""
    _, _, people = shared_people("five_people", 0)
    assert 4 <= len(people.people) <= 5


def test_the_visitor_of_the_rehabilitation_room_is_one_person():
    assert len(shared_people("iit_rehab_room", 150)[2].people) == 1
    assert len(shared_people("iit_rehab_room", 0)[2].people) == 0
