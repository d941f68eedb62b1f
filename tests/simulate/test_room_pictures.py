"""Mirrors obey the law of reflection; filtered, coarse and spoilt depth is as real cameras have it."""

import numpy as np
import pytest

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.isolation.depth_noise import smear_px
from anchorpose.lens import Intrinsics
from anchorpose.simulate import config as presets
from anchorpose.simulate.clinic import draw_clinic, look_at
from anchorpose.simulate.librealsense import smoothed_mm
from anchorpose.simulate.render import NOTHING, PATIENT, Figure, TrueImage
from anchorpose.simulate.rooms.pieces import box, triangles_of
from anchorpose.simulate.rooms.reflections import take_picture
from anchorpose.simulate.rooms.spoil import Spoil, spoilt_mm
from anchorpose.simulate.rooms.walls import Mirror, Panel, mirror_on_wall, wall_triangles
from anchorpose.simulate.sensor import SENSORS, sense
from anchorpose.simulate.shoot import set_up

WALL_M = 2.0
MIRROR = mirror_on_wall(Panel(-0.6, 0.6, 0.5, 1.8), WALL_M)
ROOM = np.concatenate([wall_triangles((x, -4.0), (x, 4.0), []) for x in (WALL_M, -1.0)])


@pytest.fixture(scope="module")
def camera() -> Camera:
    lens = Intrinsics(fx=180.0, fy=180.0, cx=100.0, cy=80.0)
    pose = look_at(np.array([0.0, 1.2, 0.0]), np.array([1.0, 1.2, 0.0]))
    return Camera(name="room", width=200, height=160, depth_scale=0.001, intrinsics=lens, T_world_camera=pose)


@pytest.fixture(scope="module")
def filtered():
    """A studio with filtered depth, and three frames before and after smoothing, metres."""
    studio = set_up(draw_clinic(presets.room(51_005, 6.0, 15.0)))
    after = [studio.shoot(frame).depths_mm[0] for frame in (20, 50, 80)]
    before = studio.readers[0].recent[80]
    return studio, [depth * np.float32(0.001) for depth in after], before * np.float32(0.001)


def cube(center_m, size_m=0.3) -> Figure:
    triangles = triangles_of([box(center_m, (size_m, size_m, size_m))])
    faces = np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3)
    return Figure(triangles.reshape(-1, 3).astype(np.float32), faces, np.ones(len(faces), np.uint8), 3)


def test_a_mirror_shows_points_as_far_behind_it_as_they_are_before_it():
    points_m = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 3))
    mirror = Mirror(np.array([0.3, 0.1, 0.2]), np.array([0.6, 0.0, 0.8]), np.zeros((0, 3, 3)))
    image_m = mirror.reflect(points_m)
    np.testing.assert_allclose(mirror.before_m(image_m), -mirror.before_m(points_m), atol=1e-12)
    np.testing.assert_allclose(np.cross(image_m - points_m, mirror.normal), 0.0, atol=1e-12)
    np.testing.assert_allclose(mirror.reflect(image_m), points_m, atol=1e-12)


def test_the_wall_behind_the_camera_is_seen_in_the_mirror_and_only_there(camera):
    picture = take_picture(camera, ROOM, np.zeros(len(ROOM), dtype=bool), MIRROR)
    glass_m = float(MIRROR.point_m[0])
    seen = picture.in_mirror & (picture.image.depth_m > 0)
    assert seen.sum() > 3000
    assert picture.image.depth_m[seen] == pytest.approx(2.0 * glass_m + 1.0, abs=1e-3)
    on_wall = ~picture.in_mirror & (picture.image.depth_m > 0)
    assert picture.image.depth_m[on_wall] == pytest.approx(WALL_M, abs=1e-3)
    assert (picture.image.label == NOTHING).all()


def test_a_mirrored_figure_is_where_the_law_of_reflection_puts_it(camera):
    picture = take_picture(camera, ROOM, np.zeros(len(ROOM), dtype=bool), MIRROR)
    figure = cube((0.8, 1.2, 0.45))
    drawn = picture.with_movers((), (figure,))
    changed = drawn.depth_m != picture.image.depth_m
    assert changed.sum() > 100
    assert (changed <= picture.in_mirror).all(), "inside of its frame only"
    assert (drawn.label == NOTHING).all()
    assert (drawn.part == 0).all()
    seen_m = transform_points(camera.require_pose(), camera.back_project(drawn.depth_m)[changed])
    outside_m = np.abs(MIRROR.reflect(seen_m) - [0.8, 1.2, 0.45]) - 0.15
    np.testing.assert_allclose(outside_m.max(axis=1), 0.0, atol=2e-3)
    centre = transform_points(invert_rigid(camera.require_pose()), MIRROR.reflect(np.array([[0.95, 1.2, 0.45]])))
    column, row = np.rint(camera.project(centre)[0]).astype(int)
    assert changed[row, column]


def test_filtered_edges_are_as_wide_as_real_ones(filtered):
    _, after, before = filtered
    assert 10 <= smear_px(after) <= 14, "12 on the real recording of an assistive-rehabilitation laboratory"
    assert smear_px([before] * 3) == 0


def test_smoothing_over_time_does_not_depend_on_the_order_in_which_frames_are_asked_for(filtered):
    studio, after, _ = filtered
    assert np.array_equal(studio.shoot(20).depths_mm[0] * np.float32(0.001), after[0])
    fresh = set_up(studio.clinic)
    for frame in (48, 49):
        fresh.shoot(frame)
    assert np.array_equal(fresh.shoot(50).depths_mm[0] * np.float32(0.001), after[1])


def test_smoothing_fills_small_holes_and_calms_what_stands_still():
    rng, spec = np.random.default_rng(1), SENSORS["realsense-filtered"]
    frames = [np.rint(2500.0 + 30.0 * rng.standard_normal((120, 160))).astype(np.uint16) for _ in range(4)]
    for frame in frames:
        frame[50:56, 60:70] = 0
    found = smoothed_mm(spec, frames)
    assert (found > 0).all()
    assert found.std() < 12.0
    assert np.median(found) == pytest.approx(2500.0, abs=25.0)


def test_the_coarse_sensor_has_steps_of_9_to_27_mm():
    spec, rng = SENSORS["kinect-v1"], np.random.default_rng(2)
    assert (spec.width, spec.height) == (320, 240)
    slope = np.tile(np.linspace(1.78, 3.0, 320, dtype=np.float32), (240, 1))
    reading = sense(rng, spec, slope, np.ones_like(slope), np.zeros_like(slope))
    steps_mm = np.diff(np.unique(reading[reading > 0]).astype(int))
    assert steps_mm.min() >= 8
    assert steps_mm.max() <= 29


def test_black_cloth_and_bare_metal_swallow_readings_and_nothing_else_does():
    image = TrueImage(*(np.zeros((120, 160), kind) for kind in (np.float32, np.float32, np.uint8, np.uint8)))
    image.label[:, :60], image.part[:, :60], image.part[:, :30] = PATIENT, 1, 2
    shiny = np.zeros((120, 160), dtype=bool)
    shiny[:, 120:] = True
    spoil = Spoil(np.array([False, False, True]), 0.4, 0.6, interference=False)
    found = spoilt_mm(np.random.default_rng(3), spoil, image, shiny, np.full((120, 160), 2000, np.uint16))
    assert (found[:, :30] == 0).mean() == pytest.approx(0.4, abs=0.12)
    assert (found[:, 30:120] == 2000).all()
    assert (found[:, 120:] == 0).mean() == pytest.approx(0.6, abs=0.12)
