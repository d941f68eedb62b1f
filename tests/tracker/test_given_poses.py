"""Given poses that floor, equipment or other cameras contradict: refused, noted, or beyond what can be asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from clinic_builder import shoot
from scipy.spatial.transform import Rotation

from anchorpose.calibration.calibration import Calibration
from anchorpose.calibration.clocks import CameraClock, Clocks, ClockSource
from anchorpose.calibration.world import find_world
from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.isolation.background import BackgroundModel, BackgroundSource
from anchorpose.isolation.depth_noise import DepthNoise
from anchorpose.isolation.scene import Scene, find_all_pieces, set_scene
from anchorpose.lens import Intrinsics
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.recording.recording import Clock, FrameSet, Recording
from anchorpose.simulate.config import SimulationConfig
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.given_poses import CameraPair, SeenPast, agreeing_poses, compare_cameras, doubt_of, seen_past
from anchorpose.tracker.preparation import Settled, scenes_of

Clinic = tuple[Recording, list[FrameSet]]
SLOW = pytest.mark.slow
BESIDE_M = np.array([0.1, 0.0, 0.08])


@pytest.fixture(scope="module")
def clinic() -> Clinic:
    """Three cameras with their true poses, a standing frame and a therapist."""
    true, recording, frames = shoot(SimulationConfig(seed=33, seconds=6.0, fps=10.0, therapists=1))
    return replace(recording, cameras=true.cameras), frames


def agreed(recording: Recording, frames: Sequence[FrameSet]) -> Calibration:
    """As ``track`` asks; the clocks are right."""
    calibration = find_world(recording, frames)
    known = (CameraClock(camera.name, Clock(), ClockSource.SURFACES) for camera in recording.cameras)
    settled = Settled(recording, Clocks(tuple(known), None, 0), calibration, tuple(range(len(frames))), tuple(frames))
    return agreeing_poses(recording, calibration, settled.clocks, scenes_of(settled, TrackConfig()), frames)


def posed(recording: Recording, index: int, turn_deg: Sequence[float] = (0, 0, 0), shift_m=(0, 0, 0)) -> Recording:
    """One camera turned where it stands, about the world's axes, and shifted."""
    T = recording.cameras[index].T_world_camera.copy()
    T[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix() @ T[:3, :3]
    T[:3, 3] += shift_m
    cameras = list(recording.cameras)
    cameras[index] = replace(cameras[index], T_world_camera=T)
    return replace(recording, cameras=tuple(cameras))


def only(clinic: Clinic, index: int, equipment: bool = True) -> Clinic:
    """What one camera alone recorded."""
    recording, frames = clinic
    alone = replace(
        recording,
        cameras=(recording.cameras[index],),
        backgrounds_m=(recording.backgrounds_m[index],),
        equipment=recording.equipment if equipment else None,
    )
    return alone, [replace(frame, depths_m=(frame.depths_m[index],)) for frame in frames]


def with_images(clinic: Clinic, order: Sequence[int], turned: Sequence[int] = ()) -> Clinic:
    """The images of camera ``order[k]`` in the folder of camera k; some turned by 180 degrees."""
    recording, frames = clinic

    def image(images: Sequence[np.ndarray], k: int) -> np.ndarray:
        return np.ascontiguousarray(images[order[k]][::-1, ::-1]) if k in turned else images[order[k]]

    every = range(len(order))
    spoilt = replace(recording, backgrounds_m=tuple(image(recording.backgrounds_m, k) for k in every))
    return spoilt, [replace(frame, depths_m=tuple(image(frame.depths_m, k) for k in every)) for frame in frames]


def test_right_poses_are_not_doubted(clinic):
    found = agreed(*clinic)
    assert found.doubts == ()
    assert found.displaced_m == 0.0


def test_a_camera_turned_by_five_degrees_is_refused_with_its_name_by_how_much_and_a_remedy(clinic):
    recording, frames = clinic
    with pytest.raises(InputError, match=r"camera left puts the equipment 2\d\d mm and 5\.0 degrees .*--ignore-given"):
        agreed(posed(recording, 1, (0, 5, 0)), frames)


@SLOW
def test_without_equipment_the_other_cameras_refuse_it(clinic):
    recording, frames = clinic
    off = posed(replace(recording, equipment=None), 1, (0, 5, 0))
    with pytest.raises(InputError, match=r"cameras (front and left|left and right) (have the people|see past)"):
        agreed(off, frames)
    assert agreed(replace(recording, equipment=None), frames).doubts == ()


def test_two_centimetres_are_noted_and_half_of_them_widen_sigma(clinic):
    recording, frames = clinic
    found = agreed(posed(recording, 1, shift_m=(0, 0, 0.02)), frames)
    assert not any(doubt.refuted for doubt in found.doubts)
    assert any("camera left puts the equipment" in note for note in found.notes)
    assert found.displaced_m == pytest.approx(0.01, abs=0.003)


def test_exchanged_folders_are_refused_as_exchanged(clinic):
    with pytest.raises(InputError, match=r"cameras front and left seem to be exchanged.*exchange their folders"):
        agreed(*with_images(clinic, (1, 0, 2)))


def test_a_camera_upside_down_is_refused_as_such(clinic):
    with pytest.raises(InputError, match=r"camera left is upside down: by its given pose.*by 180 degrees"):
        agreed(*with_images(clinic, (0, 1, 2), turned=(1,)))


@pytest.mark.parametrize("given", [True, False])
def test_a_single_camera_upside_down_is_refused_without_equipment_too(clinic, given):
    recording, frames = only(with_images(clinic, (0, 1, 2), turned=(0,)), 0, equipment=False)
    if not given:
        recording = replace(recording, cameras=(replace(recording.cameras[0], T_world_camera=None),))
    with pytest.raises(InputError, match=r"camera front is upside down: by its (given pose|images)"):
        agreed(recording, frames)


def test_a_camera_that_hangs_upside_down_with_its_true_pose_is_not_refused(clinic):
    recording, frames = only(with_images(clinic, (0, 1, 2), turned=(0,)), 0)
    lens, camera = recording.cameras[0].intrinsics, recording.cameras[0]
    hung = replace(lens, cx=camera.width - 1 - lens.cx, cy=camera.height - 1 - lens.cy)
    T = camera.T_world_camera @ np.diag([-1.0, -1.0, 1.0, 1.0])
    found = agreed(replace(recording, cameras=(replace(camera, intrinsics=hung, T_world_camera=T),)), frames)
    assert found.doubts == ()
    assert found.floor_height_m == pytest.approx(0.0, abs=0.01)


def test_one_camera_alone_is_refused_by_its_floor(clinic):
    recording, frames = only(clinic, 0, equipment=False)
    assert agreed(recording, frames).doubts == ()
    with pytest.raises(InputError, match=r"the floor that camera front sees is tilted by 5\.\d degrees by its pose"):
        agreed(posed(recording, 0, (0, 0, 5)), frames)


def test_without_equipment_one_camera_cannot_tell_that_it_is_turned_about_the_vertical(clinic):
    """What docs/calibration.md says cannot be asked."""
    recording, frames = only(clinic, 0, equipment=False)
    assert agreed(posed(recording, 0, (0, 5, 0)), frames).doubts == ()


def test_equipment_that_stands_elsewhere_for_all_cameras_is_noted(clinic):
    """They agree with each other, so not they were moved."""
    recording, frames = clinic
    parts = tuple(replace(part, center_m=part.center_m + BESIDE_M) for part in recording.equipment.parts)
    found = agreed(replace(recording, equipment=EquipmentModel(parts)), frames)
    assert any("stands elsewhere than equipment.json has it" in note for note in found.notes)
    assert found.displaced_m == 0.0


def test_a_floor_at_two_heights_is_doubted(clinic):
    recording, frames = clinic
    bare = replace(recording, equipment=None)
    heights = [
        doubt
        for doubt in find_world(posed(bare, 2, shift_m=(0, 0.06, 0)), frames).doubts
        if "heights" in doubt.sentence
    ]
    assert [doubt.refuted for doubt in heights] == [False]
    assert heights[0].cameras == ("right",)
    assert heights[0].off_m == pytest.approx(0.06, abs=0.01)


WALL_M, PERSON_M, RADIUS_M, HALF_TALL_M = 3.0, 2.2, 0.2, 0.6
NOISE_PER_M = 0.001
LENS = Intrinsics(fx=200.0, fy=200.0, cx=159.5, cy=119.5)


def camera(name: str, x_m: float, z_m: float = 0.0) -> Camera:
    pose = np.eye(4)
    pose[:3, 3] = (x_m, 0.0, z_m)
    return Camera(name=name, width=320, height=240, depth_scale=0.001, intrinsics=LENS, T_world_camera=pose)


def picture(seen_from: Camera, person: bool) -> np.ndarray:
    """A wall and, before it, an upright cylinder."""
    rays, x_m = seen_from.pixel_rays().astype(np.float64), seen_from.position_m[0]
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
    model = BackgroundModel(room, sigma, NOISE_PER_M, LENS.fx, BackgroundSource.PICTURE, noise, smear_px=smear_px)
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
        pytest.param(0.53, 0.0, False, "past 0 % of the room and ", id="3 cm along the wall"),
        pytest.param(0.7, 0.0, True, "past 0 % of the room and 83 %", id="20 cm along the wall"),
        pytest.param(0.5, 0.3, True, "past 100 % of the room", id="30 cm towards it"),
    ],
)
def test_a_camera_that_is_elsewhere_sees_past_what_the_other_shows(x_m, z_m, refuted, what):
    _, pair = agree([camera("front", 0.0), camera("left", x_m, z_m)])
    doubt = doubt_of(pair, clocks_known=True)
    assert what in pair.measured
    assert (None if doubt is None else doubt.refuted) == refuted


@pytest.mark.parametrize(
    ("of_room", "of_people", "off_m", "clocks_known", "refuted"),
    [
        pytest.param(0.4, np.nan, None, True, False, id="room elsewhere, and nobody has an outline"),
        pytest.param(0.9, np.nan, None, True, True, id="all of the room elsewhere"),
        pytest.param(0.02, 0.9, None, True, True, id="people elsewhere"),
        pytest.param(0.02, 0.9, None, False, False, id="people elsewhere, perhaps at another time"),
        pytest.param(0.9, 0.02, None, False, True, id="room elsewhere"),
        pytest.param(np.nan, 0.3, None, True, False, id="a little"),
        pytest.param(np.nan, np.nan, None, True, None, id="nothing in common"),
        pytest.param(0.9, 0.9, 0.004, True, None, id="surfaces agree: the picture of the room is an old one"),
        pytest.param(0.02, 0.02, 0.02, True, False, id="surfaces 2 cm apart"),
        pytest.param(0.02, 0.02, 0.09, True, True, id="surfaces 9 cm apart"),
    ],
)
def test_surfaces_in_common_view_decide_and_without_them_what_is_seen_past(
    of_room, of_people, off_m, clocks_known, refuted
):
    doubt = doubt_of(CameraPair(SeenPast(("front", "left"), of_room, of_people), off_m), clocks_known)
    assert (None if doubt is None else doubt.refuted) == refuted
    if doubt is not None:
        assert doubt.off_m == pytest.approx(np.nan if off_m is None else off_m, nan_ok=True)


def test_people_are_no_evidence_where_a_camera_draws_their_outlines_out():
    scenes, pair = agree([camera("front", 0.0), camera("left", 0.7)], smear_px=10)
    assert pair.past.measured == "see past 0 % of the room"
    assert all(one.background.detail.filtered for one in scenes)


def test_cameras_that_share_nothing_are_not_judged():
    _, pair = agree([camera("front", 0.0), camera("left", 50.0)])
    assert pair.measured == ""
    assert doubt_of(pair, clocks_known=True) is None


@pytest.mark.parametrize(("sigma_per_m", "low", "high"), [(0.001, 0.15, 1.0), (0.008, 0.0, 0.05)])
def test_people_in_patches_of_error_are_not_seen_past(sigma_per_m, low, high):
    """Stereo matching errs alike in neighbouring pixels: the deviation over time has it, that between pixels not."""
    rng, scenes, depths = np.random.default_rng(4), list[Scene](), list[np.ndarray]()
    for one in (camera("front", 0.0), camera("left", 0.5)):
        of_one = scene(one, one)
        model = replace(of_one.background, sigma_m=sigma_per_m * of_one.background.depth_m**2)
        scenes.append(replace(of_one, background=model))
        patches = cv2.GaussianBlur(rng.normal(size=(240, 320)).astype(np.float32), (0, 0), 3.0)
        depths.append(picture(one, person=True) * (1.0 + 0.015 * patches / patches.std()))
    sample = FrameSet(frame=0, time_s=0.0, depths_m=tuple(depths))
    [pair] = seen_past(scenes, [find_all_pieces(sample, scenes)])
    assert low <= pair.of_people <= high
