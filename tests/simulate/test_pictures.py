"""Simulated depth: the geometry of the pictures and the error of the sensors."""

from dataclasses import replace

import numpy as np
import pytest

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.lens import Intrinsics, rays_of_pixels
from anchorpose.recording.equipment import Box
from anchorpose.simulate import config as presets
from anchorpose.simulate.clinic import draw_clinic, look_at, random_stream
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.render import EQUIPMENT, NOTHING, PATIENT, Figure, draw_figures, render_still
from anchorpose.simulate.sensor import LENSES, SENSORS, draw_wiggle, intrinsics_of, sense
from anchorpose.simulate.shoot import body_centre_m, set_up

NOWHERE = np.zeros((0, 3, 3))
FLOOR = np.array([[[-9, 0, -9], [9, 0, -9], [9, 0, 9]], [[-9, 0, -9], [9, 0, 9], [-9, 0, 9]]], dtype=float)


@pytest.fixture(scope="module")
def camera() -> Camera:
    lens = Intrinsics(fx=180.0, fy=185.0, cx=100.3, cy=79.6)
    pose = look_at(np.array([2.4, 1.3, 0.2]), np.array([0.0, 0.9, 0.0]))
    return Camera(name="front", width=200, height=160, depth_scale=0.001, intrinsics=lens, T_world_camera=pose)


def flat(depth_m: float, shape=(200, 200)):
    return np.full(shape, depth_m, np.float32), np.ones(shape, np.float32)


def test_points_of_a_rendered_floor_lie_on_the_floor(camera):
    picture = render_still(camera, FLOOR, NOWHERE)
    seen = picture.depth_m > 0
    points = transform_points(camera.require_pose(), camera.back_project(picture.depth_m)[seen])
    assert seen.sum() > 10_000
    assert np.abs(points[:, 1]).max() < 2e-4
    ray = points - camera.position_m
    assert picture.cosine[seen] == pytest.approx(-ray[:, 1] / np.linalg.norm(ray, axis=1), abs=1e-4)


def test_points_of_a_rendered_box_lie_on_its_faces_and_carry_its_label(camera):
    box = Box("bar", np.array([0.1, 0.9, 0.05]), np.array([0.3, 0.6, 0.5]), np.eye(3))
    vertices, faces = box.triangles()
    picture = render_still(camera, FLOOR, vertices[faces])
    on_box = picture.label == EQUIPMENT
    points = transform_points(camera.require_pose(), camera.back_project(picture.depth_m)[on_box])
    assert on_box.sum() > 500
    assert np.abs(box.distance_m(points)).max() < 2e-4


def test_the_depth_buffer_sees_what_rays_see_and_of_two_people_the_nearer(camera):
    clinic = draw_clinic(presets.single(3, seconds=1, fps=1))
    figure = clinic.act(np.zeros(1)).figures(0)[0]
    drawn = draw_figures(camera, render_still(camera, NOWHERE, NOWHERE), (figure,))
    cast = render_still(camera, figure.skin_m[figure.faces].astype(float), NOWHERE)
    both = (drawn.depth_m > 0) & (cast.depth_m > 0)
    assert ((drawn.depth_m > 0) != (cast.depth_m > 0)).sum() < 0.005 * both.sum(), "silhouettes agree"
    assert np.quantile(np.abs(drawn.depth_m - cast.depth_m)[both], 0.999) < 1e-3
    assert np.quantile(np.abs(drawn.cosine - cast.cosine)[both], 0.99) < 1e-2
    nearer = Figure(figure.skin_m + np.float32([0.5, 0, 0]), figure.faces, figure.face_part, 3)
    still = render_still(camera, NOWHERE, NOWHERE)
    first = draw_figures(camera, still, (figure, nearer))
    second = draw_figures(camera, still, (nearer, figure))
    assert np.array_equal(first.label, second.label)
    alone = draw_figures(camera, still, (nearer,))
    assert (first.label[alone.label == 3] == 3).all()


def test_joints_project_onto_the_patient_and_lie_under_the_skin():
    config = presets.single(21, seconds=4, fps=3)
    studio = set_up(draw_clinic(config))
    camera, joints = studio.clinic.cameras[0], studio.performances[0].joints_m()
    hits = []
    for frame in range(config.frames):
        picture = studio.shoot(frame).images[0]
        inside = transform_points(invert_rigid(camera.require_pose()), joints[frame])
        columns, rows = np.rint(camera.project(inside)).astype(int).T
        on_patient = picture.label[rows, columns] == PATIENT
        depth_below = inside[:, 2] - picture.depth_m[rows, columns]
        hits.append(on_patient)
        assert (depth_below[on_patient] > -0.01).all(), "no joint is in front of the skin"
    assert np.mean(hits) > 0.97


def test_a_hole_removes_exactly_the_ball_around_the_middle_of_what_is_seen():
    config = SimulationConfig(seed=5, seconds=1, fps=2, cameras=2, equipment="none", therapists=0)
    whole, holed = (set_up(draw_clinic(c)) for c in (config, replace(config, hole_radius_m=0.12, hole_share=1.0)))
    before, after = whole.shoot(1), holed.shoot(1)
    centre = body_centre_m(whole.clinic.cameras, list(before.images))
    removed = 0
    for camera, full, pierced in zip(whole.clinic.cameras, before.depths_mm, after.depths_mm, strict=True):
        points = transform_points(camera.require_pose(), camera.back_project(full * 0.001))
        ball = np.linalg.norm(points - centre, axis=2) < 0.12
        assert (pierced[ball] == 0).all()
        assert np.array_equal(pierced[~ball], full[~ball])
        removed += ball.sum()
    assert removed > 100


def test_a_late_camera_sees_the_future_of_its_stamps():
    timely = SimulationConfig(seed=9, seconds=1, fps=4, cameras=2, therapists=1)
    expected = set_up(draw_clinic(timely)).shoot(2).images[1]
    late = set_up(draw_clinic(replace(timely, clock_late_s=(0.0, 0.25))))
    assert np.array_equal(late.shoot(1).images[1].depth_m, expected.depth_m)


@pytest.mark.parametrize(("sensor", "near_mm", "far_mm"), [("kinect-v2", 4.0, 10.0), ("azure-kinect", 2.5, 5.0)])
def test_time_of_flight_noise_is_millimetres_and_grows_with_range(sensor, near_mm, far_mm):
    spec, rng = SENSORS[sensor], np.random.default_rng(0)
    calm = np.zeros((200, 200), np.float32)
    spread = []
    for depth in (1.5, 2.4, min(3.7, spec.farthest_m - 0.1)):
        reading = sense(rng, spec, *flat(depth), calm)
        assert (reading == 0).mean() < 0.01
        spread.append(reading[reading > 0].std())
    assert spread[0] < spread[1] < spread[2] < far_mm
    assert spread[1] < near_mm * 1.2
    assert reading[reading > 0].mean() == pytest.approx(1000 * min(3.7, spec.farthest_m - 0.1), abs=0.5)


@pytest.mark.parametrize(
    ("sensor", "noise_mm"),  # of a flat surface at 2 m, by the sources named in sensor.py
    [("azure-kinect-wfov", 3.2), ("femto-bolt", 2.05), ("d435", 15.1), ("xtion", 5.7), ("iphone-lidar", 1.3)],
)
def test_noise_at_two_metres_is_the_published_one(sensor, noise_mm):
    reading = sense(np.random.default_rng(7), SENSORS[sensor], *flat(2.0), np.zeros((200, 200), np.float32))
    assert reading[reading > 0].std() == pytest.approx(noise_mm, rel=0.1)
    assert reading[reading > 0].mean() == pytest.approx(2000.0, abs=3.0)


@pytest.mark.parametrize(
    ("sensor", "across_deg", "down_deg"),  # as their makers state it
    [("azure-kinect-wfov", 120, 120), ("femto-bolt", 75, 65), ("d435", 87, 58), ("xtion", 58, 45)],
)
def test_a_sensor_sees_as_wide_as_its_maker_states(sensor, across_deg, down_deg):
    spec = SENSORS[sensor]
    rays = rays_of_pixels(intrinsics_of(spec, None), spec.width, spec.height)
    middle = rays[spec.height // 2, :, 0], rays[:, spec.width // 2, 1]
    across, down = (np.degrees(np.ptp(np.arctan(line[np.isfinite(line)]))) for line in middle)
    assert across == pytest.approx(across_deg, abs=3.0)  # makers allow themselves three degrees
    assert down == pytest.approx(down_deg, abs=3.0)


def test_depth_between_laser_points_is_smooth_within_a_surface_and_not_across_its_edge():
    depth = np.full((192, 256), 2.6, np.float32)
    depth[:, 100:150] = 2.0
    depth[60:70, 110:120] = 1.96  # a bump as large as the spacing of the points
    spec = SENSORS["iphone-lidar"]
    reading = sense(np.random.default_rng(5), spec, depth, np.ones_like(depth), np.zeros_like(depth))
    seen = np.where(reading > 0, reading.astype(float), np.nan)
    near, far = seen[80:, 104:146], seen[80:, 156:]
    assert np.nanmedian(seen[62:68, 112:118]) == pytest.approx(1980.0, abs=12.0), "half of the bump is left"
    assert np.nanmax(np.abs(near - 2000.0)) < 12.0
    assert np.nanmax(np.abs(far - 2600.0)) < 16.0
    assert np.nanstd(np.diff(near, axis=1)) < 0.7 * np.nanstd(near), "neighbours err together"


def test_stereo_noise_grows_with_the_square_of_range_in_blobs():
    spec, rng = SENSORS["realsense"], np.random.default_rng(1)
    calm = np.zeros((200, 200), np.float32)
    near, far = (sense(rng, spec, *flat(depth), calm).astype(float) for depth in (1.2, 2.4))
    ratio = far[far > 0].std() / near[near > 0].std()
    assert ratio == pytest.approx(4.0, rel=0.4)
    centred = np.where(far > 0, far - far[far > 0].mean(), 0.0)
    assert (centred[:, 1:] * centred[:, :-1]).mean() > 0.5 * (centred**2).mean(), "neighbours err together"


def test_stereo_leaves_a_shadow_beside_the_nearer_thing_on_one_side_only():
    depth = np.full((120, 240), 3.0, np.float32)
    depth[:, 100:140] = 1.5
    spec = SENSORS["realsense"]
    lost = sense(np.random.default_rng(2), spec, depth, np.ones_like(depth), np.zeros_like(depth)) == 0
    width = round(spec.focal_px * spec.baseline_m * (1 / 1.5 - 1 / 3.0))
    assert lost[:, 100 - width + 2 : 98].mean() > 0.95
    assert lost[:, 143 : 143 + width].mean() < 0.1


def test_edges_mix_near_and_far_and_lose_readings():
    depth = np.full((200, 200), 3.0, np.float32)
    depth[:, :100] = 2.0
    reading = sense(np.random.default_rng(3), SENSORS["kinect-v2"], depth, np.ones_like(depth), np.zeros_like(depth))
    edge = reading[:, 99:101]
    assert 0.1 < ((edge > 2040) & (edge < 2960)).mean() < 0.4
    assert 0.03 < (edge == 0).mean() < 0.2
    calm = reading[:, :95]
    assert ((calm > 2040) & (calm < 2960)).mean() == 0


def test_a_slanted_plane_is_no_edge_and_a_grazing_one_returns_nothing():
    rows = np.arange(200, dtype=np.float32)[:, None]
    slant = 1.3 * 365.0 / (80.0 + rows)  # the floor below a level camera at 1.3 m
    depth = np.where(slant < 4.4, slant, 0.0).astype(np.float32) * np.ones((1, 200), np.float32)
    cosine = np.where(depth > 0, 1.3 / np.maximum(depth, 1.0), 1.0).astype(np.float32)
    calm = np.zeros_like(depth)
    reading = sense(np.random.default_rng(4), SENSORS["kinect-v2"], depth, cosine, calm)
    assert (reading[60:] == 0).mean() < 0.01
    assert (sense(np.random.default_rng(4), SENSORS["kinect-v2"], depth, calm + 0.05, calm) == 0).all()


@pytest.mark.parametrize("sensor", list(SENSORS))
def test_nothing_is_read_beyond_the_range(sensor):
    spec, calm = SENSORS[sensor], np.zeros((200, 200), np.float32)
    rng = random_stream(presets.single(1), "sensor")
    beyond_m = 2.0 if spec.filtered else 0.3  # before its filters that sensor errs by decimetres at 6 m
    for depth in (spec.nearest_m - 0.1, spec.farthest_m + beyond_m, 0.0):
        assert (sense(rng, spec, *flat(depth), calm) == 0).mean() > 0.999
    assert draw_wiggle(rng, spec).shape == (spec.height, spec.width)


@pytest.mark.parametrize("lens", [name for name in LENSES if name != "pinhole"])
def test_rays_and_depth_buffer_go_through_the_same_lens(lens):
    spec = SENSORS["kinect-v2"]
    pose = look_at(np.array([1.6, 1.3, 0.2]), np.array([0.0, 0.9, 0.0]))
    size = {"width": spec.width, "height": spec.height, "depth_scale": 0.001}
    camera = Camera(name="front", **size, intrinsics=intrinsics_of(spec, lens), T_world_camera=pose)
    figure = draw_clinic(presets.single(3, seconds=1, fps=1)).act(np.zeros(1)).figures(0)[0]
    drawn = draw_figures(camera, render_still(camera, FLOOR, NOWHERE), (figure,))
    cast = render_still(camera, np.concatenate([FLOOR, figure.skin_m[figure.faces]]), NOWHERE)
    both = (drawn.depth_m > 0) & (cast.depth_m > 0)
    assert both.sum() > 30_000
    assert np.quantile(np.abs(drawn.depth_m - cast.depth_m)[both], 0.99) < 1e-3
    points = transform_points(
        camera.require_pose(), camera.back_project(drawn.depth_m)[both & (drawn.label == NOTHING)]
    )
    assert np.abs(points[:, 1]).max() < 3e-4, "the floor is flat behind every lens"
    assert not (drawn.depth_m[~camera.valid_pixels()] > 0).any()
