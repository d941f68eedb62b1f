"""The empty room, with a picture of it and without: what stands out and what does not."""

from dataclasses import replace

import numpy as np
import pytest
from room_builder import FRONT, NOISE_PER_M, ROOM, body, filtered, in_front, picture, seated
from scipy.spatial.transform import Rotation

from anchorpose.camera import transform_points
from anchorpose.isolation.background import BackgroundSource, foreground
from anchorpose.isolation.empty_room import has_moved, is_outdated, learn_background
from anchorpose.isolation.room_planes import depth_of_room
from anchorpose.recording.equipment import Box, EquipmentModel

EMPTY = picture(FRONT, *ROOM, seed=0)
EMPTY_FRAMES = [picture(FRONT, *ROOM, seed=k) for k in range(1, 5)]


def test_nobody_is_foreground_in_an_empty_room():
    model = learn_background(EMPTY, EMPTY_FRAMES, FRONT, 0.0)
    assert model.source == BackgroundSource.PICTURE
    assert foreground(picture(FRONT, *ROOM, seed=9), model).mean() < 1e-3


def test_a_body_is_foreground_down_to_its_soles():
    model = learn_background(EMPTY, EMPTY_FRAMES, FRONT, 0.0)
    depth, expected = picture(FRONT, *ROOM, *body(0, 0), seed=9), in_front(FRONT, *body(0, 0))
    found = foreground(depth, model)
    assert (found & expected).sum() > 0.97 * expected.sum()
    assert (found & ~expected).sum() < 0.02 * expected.sum()
    lowest = np.nanmin(transform_points(FRONT.T_world_camera, FRONT.back_project(np.where(found, depth, 0)))[..., 1])
    assert lowest < 0.03


def test_sigma_is_the_noise_of_picture_and_reading_together():
    model = learn_background(EMPTY, EMPTY_FRAMES, FRONT, 0.0)
    seen = EMPTY > 0
    assert np.median(model.sigma_m[seen] / EMPTY[seen] ** 2) == pytest.approx(np.sqrt(2) * NOISE_PER_M, rel=0.15)


def test_readings_where_the_background_has_none_are_foreground():
    hole = EMPTY.copy()
    hole[40:140, 100:160] = 0
    model = learn_background(hole, EMPTY_FRAMES, FRONT, 0.0)
    depth, expected = picture(FRONT, *ROOM, *body(0, 0), seed=9), in_front(FRONT, *body(0, 0))
    assert (foreground(depth, model) & expected).sum() > 0.97 * expected.sum()


def test_without_a_picture_a_body_that_walks_by_leaves_the_room_as_background():
    walk = [picture(FRONT, *ROOM, *body(0.0, z), seed=k) for k, z in enumerate(np.linspace(-1.5, 1.5, 12))]
    model = learn_background(None, walk, FRONT, 0.0)
    assert model.source == BackgroundSource.RECORDING
    expected = in_front(FRONT, *body(0.0, 0.0))
    found = foreground(picture(FRONT, *ROOM, *body(0.0, 0.0), seed=20), model)
    assert (found & expected).sum() > 0.95 * expected.sum()


def test_without_a_picture_a_patient_who_sways_in_place_is_no_background():
    sway = [picture(FRONT, *ROOM, *body(0.0, 0.04 * np.sin(k)), seed=k) for k in range(12)]
    model = learn_background(None, sway, FRONT, 0.0)
    expected = in_front(FRONT, *body(0.0, 0.0))
    found = foreground(picture(FRONT, *ROOM, *body(0.0, 0.0), seed=20), model)
    assert (found & expected).sum() > 0.85 * expected.sum()


def test_a_cupboard_that_never_moves_is_background():
    cupboard = Box("cupboard", np.array([-0.5, 0.9, 0.6]), np.array([0.4, 1.8, 0.6]), np.eye(3))
    still = [picture(FRONT, *ROOM, cupboard, seed=k) for k in range(12)]
    model = learn_background(None, still, FRONT, 0.0)
    assert foreground(picture(FRONT, *ROOM, cupboard, seed=20), model).mean() < 2e-3


def test_a_recording_of_people_only_is_all_foreground():
    alone = picture(FRONT, *body(0, 0), seed=1)
    model = learn_background(None, [alone], FRONT, None)
    assert model.source == BackgroundSource.REMOVED
    assert (foreground(alone, model) & (alone > 0)).sum() > 0.97 * (alone > 0).sum()


def test_a_camera_that_reads_only_three_metres_far_shows_a_room():
    """The wall is out of range, so few readings are left; floor and bench are not the person."""
    bench = Box("bench", np.array([-0.1, 0.22, -0.9]), np.array([0.5, 0.44, 0.9]), np.eye(3))
    parts = [(*ROOM, bench, *body(0.0, z)) for z in np.linspace(-0.2, 0.4, 8)]
    frames = [picture(FRONT, *each, seed=k) for k, each in enumerate(parts)]
    frames = [np.where(frame < 3.0, frame, np.float32(0.0)) for frame in frames]
    assert all(np.count_nonzero(frame) < 0.5 * frame.size for frame in frames)
    model = learn_background(None, frames, FRONT, 0.0)
    assert model.source == BackgroundSource.RECORDING
    expected = in_front(FRONT, bench, *body(0.0, 0.4)) & ~in_front(FRONT, bench)
    found = foreground(frames[-1], model) & (model.depth_m > 0)
    assert found[expected & (model.depth_m > 0)].mean() > 0.9
    assert found[~expected].mean() < 0.01


def pitched(turn_deg: float, axis: str, seed: int = 99) -> np.ndarray:
    """The image of the empty room of a camera that has since been turned to the pose of FRONT."""
    pose = FRONT.require_pose().copy()
    pose[:3, :3] @= Rotation.from_euler(axis, turn_deg, degrees=True).as_matrix()
    return picture(replace(FRONT, T_world_camera=pose), *ROOM, seed=seed)


WALK = [picture(FRONT, *ROOM, *body(0.0, z), seed=k) for k, z in enumerate(np.linspace(-1.0, 1.0, 8))]


@pytest.mark.parametrize(
    ("axis", "turn_deg"), [("x", 0.25), ("x", -0.25), ("x", 1.0), ("x", -1.0), ("y", 3.0), ("x", 5.0), ("y", -5.0)]
)
def test_a_picture_from_before_the_camera_moved_is_outdated_in_either_direction(axis, turn_deg):
    assert is_outdated(pitched(turn_deg, axis), WALK, FRONT)


BED = Box("bed", np.array([-0.6, 0.3, 1.0]), np.array([0.9, 0.6, 0.9]), np.eye(3))


@pytest.mark.parametrize("parts", [(), (BED,)], ids=["as it was", "a bed was there"])
@pytest.mark.parametrize("width_px", [1, 11], ids=["sharp", "filtered"])
def test_noise_people_and_furniture_do_not_make_a_picture_outdated(parts, width_px):
    frames = [filtered(frame, width_px) for frame in WALK]
    assert not is_outdated(filtered(picture(FRONT, *ROOM, *parts, seed=99), width_px), frames, FRONT)


def test_a_turn_of_less_than_noise_does_not_make_a_picture_outdated():
    assert not is_outdated(pitched(0.05, "x"), WALK, FRONT)


def test_a_single_frame_does_not_show_that_a_picture_is_outdated():
    """Its noise is unknown, and so is the noise of images without readings."""
    assert not is_outdated(pitched(1.0, "x"), WALK[:1], FRONT)
    assert not is_outdated(pitched(1.0, "x"), [np.zeros_like(WALK[0])] * 2, FRONT)


@pytest.mark.parametrize("given", [True, False], ids=["picture of the room", "learnt room"])
@pytest.mark.parametrize(("axis", "turn_deg"), [("x", 0.5), ("x", -1.0), ("y", 3.0), ("z", 2.0)])
def test_a_camera_that_is_knocked_during_the_recording_has_moved(axis, turn_deg, given):
    knocked = WALK[: len(WALK) // 2] + [pitched(turn_deg, axis, seed) for seed in range(50, 50 + len(WALK) // 2)]
    assert has_moved(learn_background(EMPTY if given else None, knocked, FRONT, 0.0), knocked)


@pytest.mark.parametrize("step_m", [(0.0, 0.0, -0.5), (0.0, 0.3, 0.0)], ids=["back", "up"])
def test_a_camera_that_is_carried_away_from_the_room_has_moved(step_m):
    pose = FRONT.require_pose().copy()
    pose[:3, 3] += pose[:3, :3] @ step_m if step_m[2] else step_m
    carried = [picture(replace(FRONT, T_world_camera=pose), *ROOM, seed=seed) for seed in range(50, 54)]
    assert has_moved(learn_background(EMPTY, WALK, FRONT, 0.0), [*WALK[:4], *carried])


@pytest.mark.parametrize("width_px", [1, 11], ids=["sharp", "filtered"])
def test_noise_and_people_do_not_move_a_camera(width_px):
    frames = [filtered(frame, width_px) for frame in WALK]
    assert not has_moved(learn_background(filtered(EMPTY, width_px), frames, FRONT, 0.0), frames)
    assert not has_moved(learn_background(EMPTY, WALK[:2], FRONT, 0.0), WALK[:2])


FRAME = EquipmentModel(
    tuple(Box("rail", np.array([0.0, 0.9, z]), np.array([0.8, 0.04, 0.04]), np.eye(3)) for z in (-0.45, 0.45))
)


def seen_over_time(*still, walker=None, equipment=None):
    """The background learnt without a picture while ``still`` parts stay and a walker crosses behind."""
    frames = []
    for k, z in enumerate(np.linspace(-1.8, 1.8, 12)):
        moving = body(-0.8, z) if walker else ()
        frames.append(picture(FRONT, *ROOM, *(equipment.parts if equipment else ()), *still, *moving, seed=k))
    return learn_background(None, frames, FRONT, 0.0, equipment)


def test_who_stands_still_in_the_equipment_is_no_furniture():
    patient = body(0.0, 0.0)
    live = picture(FRONT, *ROOM, *FRAME.parts, *patient, seed=20)
    expected = picture(FRONT, *ROOM, *FRAME.parts, *patient) < picture(FRONT, *ROOM, *FRAME.parts) - 1e-3
    found = foreground(live, seen_over_time(*patient, equipment=FRAME))
    assert (found & expected).sum() > 0.93 * expected.sum()
    assert (found & ~expected).sum() < 0.03 * expected.sum()


@pytest.mark.parametrize("person", [body(0.0, 0.5), seated(0.0, 0.5)], ids=["stands", "sits"])
def test_who_never_moves_is_no_room(person):
    """Even one who keeps as still as a mannequin; the wall and the floor behind are known."""
    expected = in_front(FRONT, *person)
    found = foreground(picture(FRONT, *ROOM, *person, seed=20), seen_over_time(*person))
    assert found[expected].mean() > 0.9
    assert found[~expected].mean() < 0.01


def test_the_room_behind_who_stands_still_is_put_together_from_floor_and_wall():
    model = seen_over_time(*body(0.0, 0.0), equipment=FRAME)
    hidden = in_front(FRONT, *body(0.0, 0.0)) & (picture(FRONT, *FRAME.parts) == 0)
    assert np.median(np.abs(model.depth_m - picture(FRONT, *ROOM))[hidden]) < 0.02


def test_the_nearest_of_the_rooms_planes_is_where_a_wall_or_the_floor_is():
    known = EMPTY.copy()
    known[60:150, 90:170] = 0
    found = depth_of_room(known, FRONT, NOISE_PER_M)
    true = picture(FRONT, *ROOM)
    assert np.median(np.abs(found - true)[60:150, 90:170]) < 0.01
    assert np.percentile(np.abs(found - true)[true > 0], 95) < 0.05


def test_furniture_is_no_wall():
    """There is room behind it, so its front says nothing of what people hide."""
    cupboard = Box("cupboard", np.array([-0.5, 1.0, 0.9]), np.array([0.4, 2.0, 1.0]), np.eye(3))
    found = depth_of_room(picture(FRONT, *ROOM, cupboard, seed=1), FRONT, NOISE_PER_M)
    assert np.median(np.abs(found - picture(FRONT, *ROOM))[picture(FRONT, *ROOM) > 0]) < 0.01


def test_a_picture_without_any_plane_tells_no_room():
    anywhere = np.random.default_rng(1).uniform(1.0, 4.0, EMPTY.shape).astype(np.float32)
    assert not depth_of_room(anywhere, FRONT, NOISE_PER_M).any()


def test_where_the_room_gives_no_reading_those_who_pass_are_no_room():
    """A dark monitor: only people in front of it are read there, each at another depth; behind them is the wall."""
    walk = [picture(FRONT, *ROOM, *body(x, 0.0), seed=k) for k, x in enumerate(np.linspace(-1.2, 0.6, 12))]
    without = picture(FRONT, *ROOM)
    for k, frame in enumerate(walk):
        dark = np.abs(frame - without) < 0.1
        dark[:, :100] = dark[:, 160:] = False
        frame[dark] = 0.0
        if k % 3:
            frame[:, 100:160] = 0.0
    model = learn_background(None, walk, FRONT, 0.0)
    behind = model.depth_m[60:120, 115:140]
    assert ((behind == 0) | (np.abs(behind - without[60:120, 115:140]) < 0.05)).mean() > 0.9


CUPBOARD = Box("cupboard", np.array([-1.0, 0.6, 0.6]), np.array([0.4, 1.2, 0.5]), np.eye(3))


@pytest.mark.thorough
def test_furniture_that_a_person_passes_closely_stays_room():
    walk = [picture(FRONT, *ROOM, CUPBOARD, *body(-0.9, z), seed=k) for k, z in enumerate(np.linspace(-1.6, 0.15, 24))]
    model = learn_background(None, walk, FRONT, 0.0)
    cupboard = in_front(FRONT, CUPBOARD) & ~in_front(FRONT, *body(-0.9, 0.15))
    alone = picture(FRONT, *ROOM, CUPBOARD, seed=50)
    assert foreground(alone, model)[cupboard].mean() < 0.05


def test_of_two_neighbouring_grey_values_neither_is_nearer():
    """A camera of disparity with steps of 5 cm at 2.5 m, many times its noise."""

    def stepped(*parts, seed: int) -> np.ndarray:
        depth = picture(FRONT, *ROOM, *parts, seed=seed)
        level = np.round(125.0 / np.where(depth > 0, depth, 1.0))
        return np.where(depth > 0, 125.0 / level, 0.0).astype(np.float32)

    model = learn_background(None, [stepped(seed=k) for k in range(12)], FRONT, 0.0)
    seen = model.depth_m > 0
    assert (model.sigma_m[seen] > 0.49 * model.depth_m[seen] ** 2 / 125.0).all()  # two sigma are a step
    assert foreground(stepped(seed=20), model).mean() < 1e-4
    expected = in_front(FRONT, *body(0.0, 0.0))
    assert (foreground(stepped(*body(0.0, 0.0), seed=20), model) & expected).sum() > 0.95 * expected.sum()


def test_a_single_frame_needs_no_allowance_for_grey_steps():
    """Of one frame, room and reading are the same reading; the allowance took away people close before a wall."""
    depth = picture(FRONT, *ROOM, seed=1)
    level = np.round(125.0 / np.where(depth > 0, depth, 1.0))
    stepped = np.where(depth > 0, 125.0 / level, 0.0).astype(np.float32)
    one, several = (learn_background(None, [stepped] * count, FRONT, 0.0) for count in (1, 12))
    seen = (one.depth_m > 0) & (several.depth_m > 0)
    half_step_m = 0.49 * several.depth_m[seen] ** 2 / 125.0
    assert (several.sigma_m[seen] > half_step_m).all()
    assert (one.sigma_m[seen] < half_step_m).mean() > 0.9
