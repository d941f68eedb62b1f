"""Noise, floor and world: known answers in built rooms, refusals, and the shared recordings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from room_builder import FRONT, KNEE_BAR, NOISE_PER_M, ROOM, body, camera_at, picture, unposed
from scipy.spatial.transform import Rotation

from anchorpose.calibration.first_frames import NoFloor, find_floor, floor_of_room, noise_per_m
from anchorpose.calibration.world import find_world
from anchorpose.camera import transform_points
from anchorpose.errors import InputError
from anchorpose.recording.equipment import Box, EquipmentModel
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.recording.recording import FrameSet, Recording

DATA = Path(__file__).parents[3] / "shared" / "data"


def recording(*cameras, backgrounds=None, equipment=None) -> Recording:
    backgrounds = backgrounds or (None,) * len(cameras)
    return Recording(folder=Path("built"), cameras=cameras, streams=(), backgrounds_m=backgrounds, equipment=equipment)


def frames(*pictures) -> list[FrameSet]:
    return [FrameSet(frame=k, time_s=k / 30, depths_m=(depth,)) for k, depth in enumerate(pictures)]


def shared(name: str) -> tuple[Recording, list[FrameSet]]:
    if not (DATA / name).exists():
        pytest.skip(f"{DATA / name} is absent: the shared recordings are not part of this project")
    opened = open_recording(DATA / name)
    last = len(opened.streams[0].files) - 1
    sampled = np.unique(np.linspace(0, last, 12).astype(int))
    return opened, [read_frame(opened, k) for k in sampled]


def test_the_noise_of_a_built_room_is_measured_within_a_fifth_and_not_on_an_empty_picture():
    assert noise_per_m([picture(FRONT, *ROOM, seed=1)]) == pytest.approx(NOISE_PER_M, rel=0.2)
    with pytest.raises(ValueError, match="noise cannot be measured"):
        noise_per_m([np.zeros((10, 10), np.float32)])


@pytest.mark.parametrize("height", [0.8, 1.2, 2.1])
def test_the_floor_is_found_at_its_height_and_tilt(height):
    camera = camera_at((2.5, height, 0.3), (0.0, 0.9, 0.0))
    floor = find_floor(picture(camera, *ROOM, seed=2), camera, NOISE_PER_M)
    assert floor.height_m == pytest.approx(height, abs=0.004)
    up_world = camera.T_world_camera[:3, :3] @ floor.up
    assert np.degrees(np.arccos(up_world[1])) < 0.15
    assert floor.residual_m < 0.01


def test_a_floor_full_of_people_is_still_the_floor():
    depth = picture(FRONT, *ROOM, *body(0.0, 0.0), *body(0.4, 0.7), *body(-0.5, -0.8), seed=3)
    floor = find_floor(depth, FRONT, NOISE_PER_M)
    assert floor.height_m == pytest.approx(1.2, abs=0.005)


def test_a_wall_alone_is_not_a_floor_and_an_empty_picture_has_none():
    assert find_floor(picture(FRONT, ROOM[1], seed=4), FRONT, NOISE_PER_M) == NoFloor.NO_PLANE
    assert find_floor(np.zeros((212, 256), np.float32), FRONT, 0.001) == NoFloor.NO_READINGS


def test_a_table_is_no_floor_where_somebody_stands_beside_it():
    """Floor and wall are black and return nothing; the table top is all that is level."""
    table = Box("table", np.array([0.9, 0.35, -0.8]), np.array([2.6, 0.7, 2.0]), np.eye(3))
    empty = picture(FRONT, table, seed=5)
    frames = [picture(FRONT, table, *body(0.3, 0.7 + 0.05 * k), seed=6 + k) for k in range(3)]
    alone = floor_of_room(FRONT, empty, [])
    assert alone.height_m == pytest.approx(0.5, abs=0.01)
    assert floor_of_room(FRONT, empty, frames) is NoFloor.NO_PLANE


def test_who_stands_on_the_floor_does_not_refute_it():
    empty = picture(FRONT, *ROOM, seed=5)
    frames = [picture(FRONT, *ROOM, *body(0.3, 0.05 * k), seed=6 + k) for k in range(3)]
    floor = floor_of_room(FRONT, empty, frames)
    assert floor.height_m == pytest.approx(1.2, abs=0.005)


def test_given_poses_are_kept_and_the_floors_height_is_measured():
    raised = replace(FRONT, T_world_camera=FRONT.T_world_camera.copy())
    raised.T_world_camera[1, 3] += 0.25  # a world whose origin lies 0.25 m below the floor
    world = find_world(recording(raised), frames(picture(FRONT, *ROOM, seed=5)))
    assert world.cameras == (raised,)
    assert world.floor_height_m == pytest.approx(0.25, abs=0.005)
    assert world.residuals[0].tilt_rad < 0.01


def test_a_floor_that_contradicts_the_given_pose_is_reported_and_not_used():
    leaning = replace(FRONT, T_world_camera=FRONT.T_world_camera.copy())
    turn = np.radians(12)
    leaning.T_world_camera[:3, :3] = (
        np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
        @ FRONT.T_world_camera[:3, :3]
    )
    world = find_world(recording(leaning), frames(picture(FRONT, *ROOM, seed=5)))
    assert world.floor_height_m is None
    assert [(doubt.refuted, "tilted by 12." in doubt.sentence) for doubt in world.doubts] == [(True, True)]


@pytest.mark.parametrize("look_m", [1.4, 0.9])
@pytest.mark.parametrize("error_deg", [1.0, 1.5, 1.9])
def test_floors_are_compared_where_the_patient_usually_is(look_m, error_deg):
    """A level camera that is pitched by an error raises the floor 2.5 m ahead by 2.5 m times the error's tangent."""
    front, left = (camera_at((2.5, 1.4, z), (0.0, look_m, z), 512, 424) for z in (-0.6, 0.6))
    depths_m = tuple(picture(camera, *ROOM, seed=6) for camera in (front, left))
    pitched = left.require_pose().copy()
    pitched[:3, :3] @= Rotation.from_euler("x", error_deg, degrees=True).as_matrix()
    cameras = front, replace(left, name="left", T_world_camera=pitched)
    world = find_world(recording(*cameras), [FrameSet(frame=0, time_s=0.0, depths_m=depths_m)])
    (doubt,) = [doubt for doubt in world.doubts if "heights that differ" in doubt.sentence]
    assert doubt.off_m == pytest.approx(2.5 * np.tan(np.radians(error_deg)), rel=0.15)
    assert not doubt.refuted


def test_a_camera_without_a_pose_gets_the_world_of_floor_and_patient():
    """The true pose is known: the patient stands at the origin and the camera is straight ahead."""
    empty, depth = picture(FRONT, *ROOM, seed=6), picture(FRONT, *ROOM, *body(0.0, 0.0), seed=7)
    world = find_world(recording(unposed(FRONT), backgrounds=(empty,)), frames(depth))
    found, true = world.cameras[0].T_world_camera, FRONT.T_world_camera
    assert found[:3, :3] == pytest.approx(true[:3, :3], abs=0.02)
    assert found[1, 3] == pytest.approx(true[1, 3], abs=0.005)
    assert found[0, 3] == pytest.approx(true[0, 3], abs=0.11)  # votes for the pelvis, of which only the front is seen
    assert found[:3, :3] @ found[:3, :3].T == pytest.approx(np.eye(3), abs=1e-9)
    assert world.floor_height_m == 0.0
    assert any("assumed to face the camera" in note for note in world.notes)


def test_a_person_without_a_room_gets_a_world_without_a_floor():
    world = find_world(recording(unposed(FRONT)), frames(picture(FRONT, *body(0.0, 0.4), seed=8)))
    assert world.floor_height_m is None
    assert any("no floor was found" in note for note in world.notes)
    pose = world.cameras[0].T_world_camera
    assert pose[:3, :3] @ np.array([0.0, -1.0, 0.0]) == pytest.approx([0, 1, 0])
    level = transform_points(pose, np.zeros(3))
    assert level[2] == pytest.approx(0.0, abs=1e-9)  # X points towards the camera
    assert level[0] > 1.5


def test_several_cameras_without_poses_are_refused_with_a_remedy_also_where_they_see_no_floor():
    """Some with a pose and some without is no question that people in view can answer."""
    with pytest.raises(
        InputError, match=r"null for front.*nothing ties them to the others' world; give every camera_to_world, or none"
    ):
        find_world(recording(unposed(FRONT), replace(FRONT, name="left")), [])
    blind = recording(unposed(FRONT), replace(unposed(FRONT), name="left"))
    with pytest.raises(InputError, match=r"null for front, left.*a camera sees no floor; give every camera_to_world"):
        find_world(blind, [])


@pytest.mark.thorough
def test_equipment_that_is_not_in_the_picture_is_refused_with_a_remedy():
    blind = recording(unposed(FRONT), equipment=EquipmentModel((KNEE_BAR,)))
    with pytest.raises(InputError, match=r"null for front, and this camera .*; compare equipment\.json"):
        find_world(blind, frames(picture(FRONT, *ROOM, seed=9)))


def test_the_pose_of_the_sample_with_holes_is_found_again():
    opened, sampled = shared("sample_holes/recording")
    true = opened.cameras[0].T_world_camera
    blind = replace(opened, cameras=(unposed(opened.cameras[0]),))
    found = find_world(blind, sampled).cameras[0].T_world_camera
    assert found[1, 3] == pytest.approx(true[1, 3], abs=0.003)
    tilt = np.arccos(np.clip((found[:3, :3] @ true[:3, :3].T)[1, 1], -1, 1))
    assert np.degrees(tilt) < 0.1


@pytest.mark.thorough
def test_the_floor_of_the_clinic_sample_is_at_zero():
    opened, sampled = shared("sample_clinic/recording")
    assert find_world(opened, sampled).floor_height_m == pytest.approx(0.0, abs=0.005)


@pytest.mark.parametrize(("name", "height"), [("iit_rehab_room", 1.23), ("five_people", 1.29)])
def test_real_floors_are_found_below_the_camera(name, height):
    """Nobody measured these: the heights are what independent runs agree on, plausible for a camera on a stand."""
    opened, sampled = shared(name)
    world = find_world(opened, sampled)
    assert world.floor_height_m == 0.0
    assert world.cameras[0].T_world_camera[1, 3] == pytest.approx(height, abs=0.05)
