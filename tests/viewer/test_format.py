"""What the viewer sends: points where the camera saw them, the body as it is skinned, which frames to check first."""

from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from recording_builder import edit_json, write_picture
from scipy.spatial.transform import Rotation
from viewer_builder import FRAMES, LOST_FRAME, UNSURE_FRAME, depth_mm, labels_of, unpack, write_small_session

from anchorpose.body.kinematics import shape_body
from anchorpose.body.pose import MOVING_BONES
from anchorpose.body.segments import load_body_asset
from anchorpose.camera import transform_points
from anchorpose.errors import InputError
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.recording import Clock
from anchorpose.results.joint_angles import joint_angles
from anchorpose.surface.mesh import build_surface
from anchorpose.viewer import payloads
from anchorpose.viewer.depth_frames import DepthFrames, clocks_of_run
from anchorpose.viewer.payloads import (
    curves_payload,
    motion_payload,
    pack,
    points_payload,
    rays_payload,
    surface_payload,
)
from anchorpose.viewer.review import APART_S, Review, open_review, worst_frames


@pytest.fixture(scope="module")
def review(tmp_path_factory: pytest.TempPathFactory) -> Review:
    return open_review(*write_small_session(tmp_path_factory.mktemp("viewer")))


@pytest.fixture(scope="module")
def depth_frames(review: Review) -> DepthFrames:
    assert review.depth_frames is not None
    return review.depth_frames


def placed(depth_frames: DepthFrames, points: np.ndarray, rays: np.ndarray, camera: int) -> np.ndarray:
    """What the page's shader does: pixel, ray and grey value to the world."""
    column, row, grey = points[:, 0].astype(int), points[:, 1].astype(int), points[:, 2]
    z = grey * depth_frames.cameras[camera].depth_scale
    seen = np.column_stack([rays[row, column] * z[:, None], z])
    return transform_points(depth_frames.cameras[camera].require_pose(), seen)


def test_arrays_come_back_as_they_were_each_at_a_place_a_browser_can_read() -> None:
    rng = np.random.default_rng(3)
    arrays = {
        "a": rng.integers(0, 255, 7).astype(np.uint8),
        "b": rng.normal(size=(3, 5)),
        "none": np.empty((0, 4), np.uint16),
        "c": rng.normal(size=(2, 3, 4)).astype(np.float32)[:, ::2],
    }
    for length in range(9):  # every length of the head
        meta, found = unpack(pack({"x": "y" * length}, arrays))
        assert meta == {"x": "y" * length}
        assert {name: array.shape for name, array in found.items()} == {n: a.shape for n, a in arrays.items()}
        assert all(np.array_equal(found[name], array) for name, array in arrays.items())
        assert all(array.ctypes.data % array.itemsize == 0 for array in found.values() if array.size)
    with pytest.raises(ValueError, match="int64"):
        pack({}, {"d": np.arange(3)})
    with pytest.raises(ValueError, match="not made by pack"):
        unpack(b"PNG.....")


def test_points_lie_where_the_camera_says_by_an_independent_way(depth_frames: DepthFrames) -> None:
    meta, arrays = unpack(points_payload(depth_frames, 7, 2, room=False))
    _, rays = unpack(rays_payload(depth_frames))
    start = 0
    for row, frame in enumerate((7, 8)):
        labels, depth_m = labels_of(frame), depth_mm(frame).astype(np.float32) * np.float32(0.001)
        for number, camera in enumerate(depth_frames.cameras):
            count = meta["counts"][row][number]
            points = arrays["points"][start : start + count]
            start += count
            finer = np.gcd(np.gcd(points[:, 0], points[:, 1]), 8)  # 8: on every eighth row and column
            assert (np.diff(finer.astype(int)) <= 0).all()  # a part of the points is a coarser picture
            points = points[np.lexsort((points[:, 0], points[:, 1]))]
            found = placed(depth_frames, points, rays[f"rays{number}"], number)
            shown = (labels > 0) & (depth_m > 0)
            expected = transform_points(camera.require_pose(), camera.back_project(depth_m)[shown])
            assert np.abs(found - expected).max() < 2e-6
            assert np.array_equal(points[:, 3] % 256, labels[shown])
    assert start == len(arrays["points"]) > 1000


def test_the_surface_is_that_of_the_stage_of_this_name(depth_frames: DepthFrames) -> None:
    meta, arrays = unpack(surface_payload(depth_frames, 4, 2))
    assert meta["counts"][0][0] > 200
    first = meta["counts"][0]
    depth_m = depth_mm(4).astype(np.float32) * np.float32(0.001)
    sheets = [build_surface(depth_m, labels_of(4) == PixelLabel.PATIENT, camera) for camera in depth_frames.cameras]
    nodes = np.concatenate([sheet.points_m for sheet in sheets])
    assert first[0] == len(nodes)
    assert np.abs(arrays["vertices"][: first[0]] / 1000.0 - nodes).max() <= 0.00051
    faces = arrays["faces"][: first[1]]
    assert faces.max() < first[0]
    sides = np.linalg.norm(nodes[faces] - nodes[np.roll(faces, 1, axis=1)], axis=2)
    assert sides.max() < 0.15


def test_frames_that_there_are_not_are_refused(review: Review, depth_frames: DepthFrames) -> None:
    of_points = partial(points_payload, depth_frames, room=False)
    for payload, most in (
        (of_points, 1000),
        (partial(motion_payload, review), 100_000),
        (partial(curves_payload, review), 100_000),
    ):
        for first, count in ((-1, 2), (FRAMES, 1), (0, 0), (0, most)):
            with pytest.raises(ValueError, match="there are no frames"):
                payload(first, count)
    assert len(unpack(of_points(FRAMES - 1, 8))[0]["counts"]) == 1


def test_the_tables_arrive_whole_with_gaps_as_gaps(review: Review) -> None:
    meta, arrays = unpack(motion_payload(review, 0, FRAMES))
    assert meta == {"first": 0}
    lost = np.isnan(arrays["joints"]).any(axis=(1, 2))
    assert np.flatnonzero(lost).tolist() == [LOST_FRAME]
    assert np.isnan(arrays["poses"][LOST_FRAME]).all()
    assert np.isnan(arrays["angles"][LOST_FRAME]).all()
    kept, joints = ~lost, review.joints
    assert np.allclose(arrays["joints"][kept], joints.position_m[kept], atol=1e-6)
    column = review.angles.names.index("knee_flexion_left")
    expected = joint_angles(joints)
    there = expected.names.index("knee_flexion_left")
    assert np.allclose(arrays["angles"][kept, column], expected.degrees[kept, there], atol=1e-3)
    assert np.isnan(arrays["anchors"][0, 1:]).all()
    _, some = unpack(motion_payload(review, 29, 3))
    assert all(np.array_equal(some[name], arrays[name][29:32], equal_nan=True) for name in arrays)


@pytest.mark.parametrize(("influences", "off_m"), [(7, 1e-5), (payloads.INFLUENCES, 0.005)])
def test_the_page_skins_the_body_as_the_body_skins_itself(
    monkeypatch: pytest.MonkeyPatch, influences: int, off_m: float
) -> None:
    """With all influences exactly; with the four that it is sent within 5 mm, in a pose of 20 degrees a bone."""
    monkeypatch.setattr(payloads, "INFLUENCES", influences)
    rng = np.random.default_rng(11)
    asset, coefficients = load_body_asset(), rng.normal(size=16)
    arrays = payloads.body_skin({"body": {"coefficients": coefficients.tolist()}})
    body, rows = shape_body(asset, coefficients), [asset.bone(name) for name in MOVING_BONES]
    relative = np.tile(np.eye(3), (len(asset.bone_names), 1, 1))
    relative[rows] = Rotation.from_rotvec(rng.normal(scale=0.2, size=(len(rows), 3))).as_matrix()
    transforms = body.bone_transforms(relative, np.array([0.3, 0.9, -0.2]))
    turns, heads = transforms[rows, :3, :3], transforms[rows]
    places = np.einsum("bij,bj->bi", heads[:, :3, :3], body.bone_heads[rows]) + heads[:, :3, 3]
    posed = np.zeros_like(body.vertices)
    for k in range(influences):
        bone = arrays["bones"][:, k]
        arm = arrays["vertices"] - arrays["heads"][bone]
        posed += arrays["weights"][:, k, None] * (np.einsum("vij,vj->vi", turns[bone], arm) + places[bone])
    assert np.linalg.norm(posed - body.skin(transforms), axis=1).max() < off_m


def test_frames_to_check_name_what_is_wrong_and_lie_apart(review: Review) -> None:
    share = review.matched_share.copy()
    share[22] = 0.4
    found = worst_frames(review.joints, share, review.run["dropped"])
    told = {frame.position: frame.reason for frame in reversed(found)}
    assert (found[0].position, told[LOST_FRAME]) == (LOST_FRAME, "all joints lost")
    assert told[3] == "front/depth/000003.png is truncated"
    assert told[22] == "40 % of the points found again in the next frame"
    unsure = [frame for frame in found if "sigma" in frame.reason]
    assert (unsure[0].position, unsure[0].joint) == (UNSURE_FRAME, JOINT_INDEX["HandRight"])
    assert unsure[0].reason == "HandRight: sigma 200 mm"
    assert np.diff(sorted(review.joints.time_s[frame.position] for frame in unsure)).min() >= APART_S


def test_an_interval_of_unusable_images_is_listed_once_and_the_longest_comes_first(review: Review) -> None:
    frames = (2, *range(20, 36), 38, 44)  # at 15 frames per second, so that 44 lies within a second of 38
    dropped = [{"frame": frame, "time_s": frame / 15.0, "why": f"no depth in {frame}"} for frame in frames]
    joints = replace(review.joints, state_code=np.zeros_like(review.joints.state_code))
    found = [frame for frame in worst_frames(joints, np.ones(FRAMES), dropped) if frame.reason.startswith("no depth")]
    assert [(frame.position, frame.reason) for frame in found] == [(row, f"no depth in {row}") for row in (20, 2, 38)]
    every_second = [{"frame": frame, "time_s": frame / 15.0, "why": "dark"} for frame in range(0, FRAMES, 10)]
    found = [frame for frame in worst_frames(joints, np.ones(FRAMES), every_second) if frame.reason == "dark"]
    assert np.diff([joints.time_s[frame.position] for frame in found]).min() >= APART_S


def test_a_curve_is_broken_at_a_pause_and_where_an_angle_passes_180_degrees(review: Review) -> None:
    """The broken points are found in every stretch of the recording that the page asks for, however short."""
    joints, angles = review.joints, review.angles
    time_s, degrees = joints.time_s + 60.0 * (joints.frame >= 25), angles.degrees.copy()
    column = angles.column("pelvis_rotation")
    degrees[:, column] = np.where(np.arange(FRAMES) % 20 < 10, -179.0, 179.0)  # passes 180 in 10, 20, 30 and 40
    paused = replace(
        review, joints=replace(joints, time_s=time_s), angles=replace(angles, time_s=time_s, degrees=degrees)
    )
    for first, count, broken in ((0, FRAMES, {10, 20, 25, 30, 40}), (24, 2, {25}), (19, 2, {20}), (11, 9, set())):
        _, arrays = unpack(curves_payload(paused, first, count))
        points = slice(arrays["start"][column] + 1, arrays["start"][column + 1])
        assert set(arrays["row"][points][arrays["broken"][points] > 0].tolist()) == broken


def test_clocks_are_those_that_the_run_used_and_a_run_that_states_none_is_refused() -> None:
    found = Clock(ahead_s=0.25, drift=1e-4, at_s=-1.5)
    run = {"cameras": [{"name": "left", "clock": asdict(found)}, {"name": "front", "clock": asdict(Clock())}]}
    assert clocks_of_run(Path("run.json"), run, ("front", "left")) == (Clock(), found)
    with pytest.raises(InputError, match="track the recording again"):
        clocks_of_run(Path("run.json"), {"cameras": [{"name": "front"}]}, ("front",))


def test_another_recording_is_refused(tmp_path: Path) -> None:
    results, recording = write_small_session(tmp_path)
    edit_json(recording / "recording.json", lambda document: document.update(subject={"height_m": 1.7}))
    open_review(results, recording)  # a height added makes no other recording of it
    write_picture(recording / "front" / "depth" / f"{FRAMES - 1:06d}.png", depth_mm(3))
    with pytest.raises(InputError, match=r"000044.png: is not what the results were made of"):
        open_review(results, recording)
    edit_json(recording / "recording.json", lambda document: document["cameras"].pop())
    with pytest.raises(InputError, match="has the cameras front, not front, right"):
        open_review(results, recording)


def test_results_without_some_tables_are_looked_at_without_them(tmp_path: Path) -> None:
    results, _ = write_small_session(tmp_path)
    for name in ("poses", "anchors", "people", "contacts"):
        (results / f"{name}.parquet").unlink()
    found = open_review(results, None)
    assert found.poses is None
    assert set(unpack(motion_payload(found, 0, 5))[1]).isdisjoint({"poses", "anchors"})
    shorter = replace(found, run={**found.run, "association": {"matched_share": [0.5]}})
    assert np.isnan(shorter.matched_share).all()  # of other frames: nothing is known
