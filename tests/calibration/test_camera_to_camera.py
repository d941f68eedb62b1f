"""Camera to camera: known answers in a room where people of cylinders walk, and refusals where that is no evidence."""

from dataclasses import replace

import numpy as np
import pytest
from moving_room import FRONT, LEFT, walking
from room_builder import NOISE_PER_M, ROOM, body, picture

from anchorpose.calibration.camera_to_camera import (
    WORST_IMPOSSIBLE,
    CameraToCamera,
    NoCameraToCamera,
    PlacingConfig,
    find_camera_to_camera,
    place_cameras,
)
from anchorpose.calibration.common_view import level_view, outside_silhouette
from anchorpose.calibration.first_frames import FloorPlane, NoFloor, find_floor
from anchorpose.camera import invert_rigid
from anchorpose.recording.recording import FrameSet

CAMERAS = (FRONT, LEFT)
EMPTY = tuple(picture(camera, *ROOM, seed=900 + k) for k, camera in enumerate(CAMERAS))
FLOORS = tuple(find_floor(empty, camera, NOISE_PER_M) for empty, camera in zip(EMPTY, CAMERAS, strict=True))
CONFIG = PlacingConfig(step_px=2)  # the pictures of these tests are small


def frames(scene, count: int = 12) -> list[FrameSet]:
    times_s = np.linspace(0.0, 9.0, count)

    def depths_m(k: int, t: float) -> tuple:
        return tuple(picture(camera, *ROOM, *scene(t), seed=2 * k + n) for n, camera in enumerate(CAMERAS))

    return [FrameSet(frame=k, time_s=t, depths_m=depths_m(k, t)) for k, t in enumerate(times_s.tolist())]


@pytest.fixture(scope="module")
def found() -> CameraToCamera | NoCameraToCamera:
    return place_cameras(CAMERAS, FLOORS, EMPTY, frames(walking), CONFIG)


def test_two_cameras_are_placed_by_the_people_both_see_at_their_heights_over_the_floor(found):
    assert isinstance(found, CameraToCamera)
    true = invert_rigid(FRONT.T_world_camera) @ LEFT.T_world_camera
    off = invert_rigid(true) @ found.T_first_camera[1]
    assert np.linalg.norm(off[:3, 3]) < 0.02
    assert np.degrees(np.arccos(np.clip((np.trace(off[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))) < 0.5
    up = FLOORS[0].up
    placed = found.T_first_camera[1][:3, 3]
    assert up @ placed + FLOORS[0].height_m == pytest.approx(LEFT.T_world_camera[1, 3], abs=0.01)


def test_an_empty_room_and_a_camera_without_a_floor_are_refused():
    assert place_cameras(CAMERAS, FLOORS, EMPTY, frames(lambda t: (), 6), CONFIG) is NoCameraToCamera.NOTHING_COMMON
    assert isinstance(FLOORS[0], FloorPlane)
    answer = find_camera_to_camera(None, (FLOORS[0], NoFloor.NO_PLANE), CONFIG)
    assert answer is NoCameraToCamera.NO_FLOOR


def test_a_few_seconds_are_refused():
    """People who have hardly walked fit at several places."""
    short = [replace(frame, time_s=frame.time_s / 3.0) for frame in frames(walking, 3)]
    assert place_cameras(CAMERAS, FLOORS, EMPTY, short, CONFIG) is NoCameraToCamera.TOO_SHORT


@pytest.mark.thorough
def test_one_round_person_who_never_moves_is_refused():
    """A turn about a pillar changes nothing in any picture."""
    answer = place_cameras(CAMERAS, FLOORS, EMPTY, frames(lambda t: body(0.0, 0.0), 8), CONFIG)
    assert isinstance(answer, NoCameraToCamera)


def test_people_at_other_places_in_each_camera_are_refused():
    """Clocks that are seconds apart, or two rooms: the surfaces never agree."""
    first, second = frames(walking, 8), frames(lambda t: walking(t + 2.3), 8)
    mixed = [
        replace(one, depths_m=(one.depths_m[0], other.depths_m[1])) for one, other in zip(first, second, strict=True)
    ]
    assert isinstance(place_cameras(CAMERAS, FLOORS, EMPTY, mixed, CONFIG), NoCameraToCamera)


def test_people_fall_upon_the_people_another_camera_sees_and_beside_them_where_the_pose_is_wrong():
    pictures = frames(walking, 4)
    first, second = (
        level_view(CAMERAS[k], FLOORS[k], EMPTY[k], [frame.depths_m[k] for frame in pictures], 2) for k in (0, 1)
    )
    true = invert_rigid(FRONT.T_world_camera) @ LEFT.T_world_camera
    beside, common = outside_silhouette(first, second, true)
    assert beside < WORST_IMPOSSIBLE
    assert common > 0.8
    wrong = true.copy()
    wrong[0, 3] += 0.4
    assert outside_silhouette(first, second, wrong)[0] > 2 * WORST_IMPOSSIBLE
