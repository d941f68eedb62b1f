"""Two cameras that show one wall and one person: right poses agree, and a camera that slid along the wall does not."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from anchorpose.calibration.displacement import Displacement, common_surfaces, find_displacement
from anchorpose.camera import Camera, transform_points
from anchorpose.isolation.background import BackgroundModel, BackgroundSource
from anchorpose.isolation.depth_noise import DepthNoise, Sensor
from anchorpose.isolation.scene import Scene, find_all_pieces, set_scene
from anchorpose.lens import Intrinsics
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.pose_agreement import REFUTED_M, CameraPair, SeenPast, compare_cameras, doubt_of, seen_past

WALL_M, PERSON_M, RADIUS_M, HALF_TALL_M = 3.0, 2.2, 0.2, 0.6
NOISE_PER_M = 0.001
LENS = Intrinsics(fx=200.0, fy=200.0, cx=159.5, cy=119.5)


def camera(name: str, x_m: float, z_m: float = 0.0) -> Camera:
    pose = np.eye(4)
    pose[:3, 3] = (x_m, 0.0, z_m)
    return Camera(name=name, width=320, height=240, depth_scale=0.001, intrinsics=LENS, T_world_camera=pose)


def picture(seen_from: Camera, person: bool, at_m: float = 0.0) -> np.ndarray:
    """A wall and, before it, an upright cylinder, ``at_m`` beside the first camera's axis."""
    rays, x_m = seen_from.pixel_rays().astype(np.float64), seen_from.position_m[0] - at_m
    a, b = rays[..., 0] ** 2 + 1.0, rays[..., 0] * x_m - PERSON_M
    root = b**2 - a * (x_m**2 + PERSON_M**2 - RADIUS_M**2)
    depth = (-b - np.sqrt(np.maximum(root, 0.0))) / a
    on_person = (root > 0) & (np.abs(rays[..., 1] * depth) < HALF_TALL_M) & person
    return np.where(on_person, depth, WALL_M).astype(np.float32)


def scene(given: Camera, true: Camera, smear_px: int = 0) -> Scene:
    """A camera that was somewhere (``true``) and is said to be elsewhere (``given``)."""
    room = picture(true, person=False)
    sigma = np.full_like(room, NOISE_PER_M) * room**2
    noise = DepthNoise((WALL_M,), (NOISE_PER_M * WALL_M**2,))
    sensor = Sensor(max(smear_px, 2.0), LENS.fx, noise_per_m=NOISE_PER_M, noise=noise)
    model = BackgroundModel(room, sigma, sensor, BackgroundSource.PICTURE)
    return set_scene(given, model, None)


def agree(given: Sequence[Camera], smear_px: int = 0) -> tuple[list[Scene], CameraPair]:
    true = [camera("front", 0.0), camera("left", 0.5)]
    scenes = [scene(one, other, smear_px) for one, other in zip(given, true, strict=True)]
    sample = FrameSet(frame=0, time_s=0.0, depths_m=tuple(picture(one, person=True) for one in true))
    [pair] = compare_cameras(scenes, [one.background.depth_m for one in scenes], [sample])
    return scenes, pair


@pytest.mark.parametrize(
    ("x_m", "z_m", "refuted", "what"),
    [
        pytest.param(0.5, 0.0, None, "past 0 % of the room and 0 % of the people", id="right"),
        pytest.param(0.53, 0.0, None, "past 0 % of the room and 0 % of the people", id="3 cm along the wall"),
        pytest.param(0.7, 0.0, True, "past 0 % of the room and 45 %", id="20 cm along the wall"),
        pytest.param(0.5, 0.3, True, "past 100 % of the room", id="30 cm towards it"),
    ],
)
def test_a_camera_that_is_elsewhere_sees_past_what_the_other_shows(x_m, z_m, refuted, what):
    _, pair = agree([camera("front", 0.0), camera("left", x_m, z_m)])
    doubt = doubt_of(pair)
    assert what in pair.measured
    assert (None if doubt is None else doubt.refuted) == refuted


@pytest.mark.parametrize(
    ("of_room", "of_people", "by", "refuted"),
    [
        pytest.param(0.4, np.nan, None, False, id="room elsewhere, and nobody has an outline"),
        pytest.param(0.9, np.nan, None, True, id="all of the room elsewhere"),
        pytest.param(0.02, 0.9, None, True, id="people elsewhere"),
        pytest.param(0.9, 0.02, None, True, id="room elsewhere"),
        pytest.param(np.nan, 0.3, None, False, id="a little"),
        pytest.param(np.nan, np.nan, None, None, id="nothing in common"),
        pytest.param(0.9, 0.9, (0.004, 0.01), None, id="surfaces agree: the picture of the room is an old one"),
        pytest.param(0.02, 0.02, (0.02, None), False, id="surfaces 2 cm apart"),
        pytest.param(0.9, 0.9, (0.12, 0.04), False, id="surfaces 12 cm apart, as two cameras that are 8 cm off"),
        pytest.param(0.02, 0.02, (0.2, None), True, id="surfaces 20 cm apart"),
        pytest.param(0.02, 0.02, (0.05, 0.09), True, id="surfaces turned by five degrees"),
    ],
)
def test_surfaces_in_common_view_decide_and_without_them_what_is_seen_past(of_room, of_people, by, refuted):
    displacement = None if by is None else Displacement(*by)
    doubt = doubt_of(CameraPair(SeenPast(("front", "left"), of_room, of_people), displacement))
    assert (None if doubt is None else doubt.refuted) == refuted
    if doubt is not None:
        assert doubt.off_m == pytest.approx(np.nan if by is None else by[0], nan_ok=True)


@pytest.mark.parametrize(
    ("x_m", "clocks_known", "refuted"), [(0.5, True, True), (0.5, False, None), (1.3, True, True), (1.3, False, True)]
)
def test_unknown_clocks_excuse_people_who_move_and_not_a_camera_elsewhere(x_m, clocks_known, refuted):
    """A person steps aside and back; the second camera's frames are late by one step."""
    true, given = [camera("front", 0.0), camera("left", 0.5)], [camera("front", 0.0), camera("left", x_m)]
    scenes = [scene(one, other) for one, other in zip(given, true, strict=True)]
    places_m = (0.0, 0.6, 0.0, 0.6, 0.0)
    samples = [
        FrameSet(frame=k, time_s=k / 10.0, depths_m=(picture(true[0], True, here), picture(true[1], True, late)))
        for k, (here, late) in enumerate(zip(places_m[1:], places_m[:-1], strict=True))
    ]
    [past] = seen_past(scenes, [find_all_pieces(sample, scenes) for sample in samples], clocks_known)
    doubt = doubt_of(CameraPair(past, None))
    assert (None if doubt is None else doubt.refuted) == refuted


def test_people_are_no_evidence_where_a_camera_draws_their_outlines_out():
    scenes, pair = agree([camera("front", 0.0), camera("left", 0.7)], smear_px=10)
    assert pair.past.measured == "see past 0 % of the room"
    assert all(one.background.sensor.filtered for one in scenes)


def test_cameras_that_share_nothing_are_not_judged():
    _, pair = agree([camera("front", 0.0), camera("left", 50.0)])
    assert pair.measured == ""
    assert doubt_of(pair) is None


def test_people_in_patches_of_error_are_not_seen_past():
    """Stereo matching errs alike in neighbouring pixels."""
    rng, scenes, depths = np.random.default_rng(4), list[Scene](), list[np.ndarray]()
    for one in (camera("front", 0.0), camera("left", 0.5)):
        scenes.append(scene(one, one))
        patches = cv2.GaussianBlur(rng.normal(size=(240, 320)).astype(np.float32), (0, 0), 3.0)
        depths.append(picture(one, person=True) * (1.0 + 0.015 * patches / patches.std()))
    sample = FrameSet(frame=0, time_s=0.0, depths_m=tuple(depths))
    [pair] = seen_past(scenes, [find_all_pieces(sample, scenes)])
    assert pair.of_people <= 0.05


THIN = tuple((x_m, 2.4, 0.02) for x_m in np.linspace(-1.2, 1.2, 9))


def corner(seen_from: Camera, poles: Sequence[tuple[float, float, float]] = ()) -> np.ndarray:
    """A corner of two walls and a floor, with upright poles (x, z, radius, in m) before it."""
    rays = seen_from.pixel_rays().astype(np.float64)
    ray = np.dstack([rays, np.ones(rays.shape[:2])]) @ seen_from.require_pose()[:3, :3].T
    origin = seen_from.position_m
    planes = (((0, 0, 1), 3.5), ((1, 0, 0), 1.8), ((0, 1, 0), 1.1))
    with np.errstate(divide="ignore"):
        lengths = [(reach - origin @ normal) / (ray @ normal) for normal, reach in planes]
    depth = np.min([np.where(length > 0, length, np.inf) for length in lengths], axis=0)
    for x_m, z_m, radius_m in poles:
        a, b = ray[..., 0] ** 2 + ray[..., 2] ** 2, ray[..., 0] * (origin[0] - x_m) + ray[..., 2] * (origin[2] - z_m)
        root = b**2 - a * ((origin[0] - x_m) ** 2 + (origin[2] - z_m) ** 2 - radius_m**2)
        hit = (-b - np.sqrt(np.maximum(root, 0.0))) / a
        depth = np.where((root > 0) & (hit > 0), np.minimum(depth, hit), depth)
    return np.where(np.isfinite(depth) & (depth < 6.0), depth, 0.0).astype(np.float32)


@pytest.mark.parametrize(
    ("off_m", "turn_deg", "scale"), [(0.0, 0.0, 1.0), (0.03, 0.7, 1.0), (0.03, 0.7, 1.02), (0.3, 0.0, 1.0)]
)
def test_a_displacement_is_measured_among_edges_and_through_a_wrong_lens(off_m, turn_deg, scale):
    true = [camera("front", 0.0), camera("left", 0.4)]
    rooms = [corner(one, THIN) for one in true]
    T = true[1].require_pose().copy()
    T[:3, :3] = Rotation.from_euler("y", turn_deg, degrees=True).as_matrix()
    T[:3, 3] += np.array([0.6, 0.5, 0.62]) * off_m
    lens = replace(LENS, fx=scale * LENS.fx, fy=scale * LENS.fy)
    given = [replace(true[0], intrinsics=lens), replace(true[1], T_world_camera=T, intrinsics=lens)]
    views = [common_surfaces(one, room, room, [room]) for one, room in zip(given, rooms, strict=True)]
    found = find_displacement(*views)
    place = views[1].seen[0].points_m.mean(axis=0)[None]
    expected_m = np.linalg.norm(transform_points(T, place) - transform_points(true[1].require_pose(), place))
    assert found.off_m == pytest.approx(expected_m, abs=0.015 if scale == 1.0 else 0.05)
    assert (found.off_m > REFUTED_M) == (off_m == 0.3)


@pytest.mark.parametrize("off_m", [(0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, 0.6)])
def test_floor_and_walls_that_coincide_are_no_distance_where_the_people_do_not(off_m):
    """Floor and back wall of a camera that is 1 m aside still coincide: the distance was said to be 0 mm."""
    true = [camera("front", 0.0), camera("left", 0.4)]
    T = true[1].require_pose().copy()
    T[:3, 3] += off_m
    people = ((0.0, 2.2, 0.2), (0.7, 2.6, 0.15), (-0.6, 2.7, 0.15))
    views = [
        common_surfaces(given, corner(seen_from), corner(seen_from), [corner(seen_from, people)])
        for given, seen_from in zip((true[0], replace(true[1], T_world_camera=T)), true, strict=True)
    ]
    found = find_displacement(*views)
    if any(off_m):
        assert found is None or found.off_m > REFUTED_M
    else:
        assert found.off_m < 0.001
