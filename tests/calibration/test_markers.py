"""Markers: rendered tags and boards give the camera's true pose back, or a named reason why not."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from room_builder import camera_at
from scipy.spatial.transform import Rotation

from anchorpose.calibration import markers
from anchorpose.calibration.calibration import PoseSource
from anchorpose.calibration.marker_layout import Board, MarkerLayout, Tag
from anchorpose.calibration.markers import MarkerPose, NoMarkers, place_by_markers, pose_from_markers
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.errors import InputError
from anchorpose.recording.document import read_document
from anchorpose.recording.recording import UNKNOWN, Recording

DICTIONARY = "DICT_APRILTAG_36h11"
FACING_X = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # a tag that is read from +X: its x is -Z, its z is X
CAMERA = camera_at((2.2, 1.3, 0.3), (0.0, 0.8, 0.0), width=512, height=424)
FINE = 4  # samples a pixel and direction


def tag(number: int, center, size_m: float = 0.2, turn=(0.0, 0.0, 0.0)) -> Tag:
    pose = np.eye(4)
    pose[:3, :3] = FACING_X @ Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    pose[:3, 3] = center
    return Tag(number, size_m, pose)


SPREAD = (
    tag(0, (0.3, 1.1, -0.4)),
    tag(1, (0.3, 0.4, -0.4), turn=(0, 25, 0)),
    tag(2, (0.1, 1.1, 0.4), turn=(20, -25, 0)),
    tag(3, (-0.1, 0.5, 0.4)),
)


def drawn_on(image: np.ndarray, camera: Camera, texture: np.ndarray, corners_m: np.ndarray) -> None:
    """Lays a texture whose four corners, clockwise from its upper left, are at world places over a fine image."""
    pixels = camera.project(transform_points(invert_rigid(camera.require_pose()), corners_m))
    fine = ((pixels + 0.5) * FINE - 0.5).astype(np.float32)
    side_y, side_x = texture.shape
    square = np.array([[0, 0], [side_x, 0], [side_x, side_y], [0, side_y]], np.float32) - 0.5
    warp = cv2.getPerspectiveTransform(square, fine)
    size = image.shape[1], image.shape[0]
    mask = cv2.warpPerspective(np.full_like(texture, 255), warp, size, flags=cv2.INTER_NEAREST)
    image[mask > 0] = cv2.warpPerspective(texture, warp, size, flags=cv2.INTER_LINEAR)[mask > 0]


def finished(image: np.ndarray, seed: int, noise: float = 4.0, blur_px: float = 0.6) -> np.ndarray:
    """Averaged to pixels, blurred as by a lens, with noise."""
    small = cv2.resize(image, None, fx=1 / FINE, fy=1 / FINE, interpolation=cv2.INTER_AREA).astype(np.float64)
    small = cv2.GaussianBlur(small, (0, 0), blur_px)
    small += np.random.default_rng(seed).normal(0.0, noise, small.shape)
    return np.clip(small, 0, 255).astype(np.uint8)


def photo(camera: Camera, tags, seed: int = 0, **finish) -> np.ndarray:
    """Tags on white cards before a grey room."""
    image = np.full((camera.height * FINE, camera.width * FINE), 120, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    for each in tags:
        print_px, rim = 400, 80
        texture = np.full((print_px + 2 * rim,) * 2, 235, np.uint8)
        texture[rim:-rim, rim:-rim] = cv2.aruco.generateImageMarker(dictionary, each.number, print_px)
        card = Tag(each.number, each.size_m * (print_px + 2 * rim) / print_px, each.T_world_tag)
        drawn_on(image, camera, texture, card.corners_m())
    return finished(image, seed, **finish)


def depth_of(camera: Camera, tags, seed: int = 0) -> np.ndarray:
    """What a depth camera reads on the tags' cards, and nothing elsewhere."""
    depth = np.zeros((camera.height, camera.width), np.float32)
    T = invert_rigid(camera.require_pose())
    rays = np.concatenate([camera.pixel_rays(), np.ones((camera.height, camera.width, 1))], axis=2)
    for each in tags:
        corners = transform_points(T, each.corners_m())
        normal = T[:3, :3] @ each.T_world_tag[:3, 2]
        mask = np.zeros(depth.shape, np.uint8)
        cv2.fillConvexPoly(mask, np.rint(camera.project(corners)).astype(np.int32), 1)
        plane = (normal @ corners[0]) / (rays @ normal)
        depth[mask > 0] = plane[mask > 0]
    depth += np.where(depth > 0, np.random.default_rng(seed).normal(0, 0.003, depth.shape), 0)
    return depth.astype(np.float32)


def errors(found: MarkerPose, camera: Camera) -> tuple[float, float]:
    """Metres and radians off the truth."""
    off = invert_rigid(camera.require_pose()) @ found.T_world_camera
    return float(np.linalg.norm(off[:3, 3])), float(Rotation.from_matrix(off[:3, :3]).magnitude())


def layout(*tags: Tag) -> MarkerLayout:
    return MarkerLayout(format="marker-layout", version=1, dictionary=DICTIONARY, tags=tags)


def test_four_tags_in_two_depths_give_the_pose_to_millimetres_and_depth_makes_it_more_accurate():
    found = pose_from_markers(photo(CAMERA, SPREAD), CAMERA, layout(*SPREAD))
    assert isinstance(found, MarkerPose)
    off_m, off_rad = errors(found, CAMERA)
    assert off_m < 0.006
    assert off_rad < np.radians(0.2)
    assert found.markers == (0, 1, 2, 3)
    assert found.corners == 16
    assert found.rms_px < 0.5
    plain = pose_from_markers(photo(CAMERA, SPREAD), CAMERA, layout(*SPREAD))
    deep = pose_from_markers(photo(CAMERA, SPREAD), CAMERA, layout(*SPREAD), depth_of(CAMERA, SPREAD))
    assert isinstance(plain, MarkerPose)
    assert deep.sigma_m < plain.sigma_m
    assert errors(deep, CAMERA)[0] < 0.006


def test_the_stated_sigma_is_that_of_the_errors():
    cameras = [camera_at((2.2 + 0.1 * k, 1.2 + 0.05 * k, 0.5 - 0.2 * k), (0, 0.8, 0), 512, 424) for k in range(8)]
    poses = [pose_from_markers(photo(c, SPREAD, seed=k), c, layout(*SPREAD)) for k, c in enumerate(cameras)]
    scaled = [errors(p, c)[0] / p.sigma_m for p, c in zip(poses, cameras, strict=True) if isinstance(p, MarkerPose)]
    assert len(scaled) == 8
    # the length of a 3-D error has a median of 1.5 sigmas; corners that were drawn without a lens err less than assumed
    assert 0.2 < np.median(scaled) < 2.5
    assert max(scaled) < 4.5


def board_of(scale: float) -> tuple[MarkerLayout, np.ndarray, Tag]:
    """A board of 0.6 x 0.75 m, its picture when it was printed at a scale, and a tag that covers its middle."""
    pose = tag(0, (0.2, 1.1, 0.35)).T_world_tag
    pose[:3, :3] @= np.diag([1.0, -1.0, -1.0]) @ Rotation.from_euler("xyz", (15, -20, 0), degrees=True).as_matrix()
    known = cv2.aruco.CharucoBoard((4, 5), 0.15, 0.12, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    texture = known.generateImage((1200, 1500))
    corners = scale * np.array([[0, 0, 0], [0.6, 0, 0], [0.6, 0.75, 0], [0, 0.75, 0]])
    image = np.full((CAMERA.height * FINE, CAMERA.width * FINE), 120, np.uint8)
    drawn_on(image, CAMERA, texture, transform_points(pose, corners))
    board = Board(4, 5, 0.15, 0.12, pose)
    middle = pose.copy()
    middle[:3, 3] = transform_points(pose, corners.mean(axis=0, keepdims=True))[0]
    stated = MarkerLayout(format="marker-layout", version=1, dictionary="DICT_4X4_50", board=board)
    return stated, finished(image, 1), Tag(0, 0.5, middle)


@pytest.mark.parametrize("scale", [0.94, 0.97, 1.03])
def test_a_print_at_another_scale_is_refused_where_the_depth_shows_it(scale):
    """The corners fit a nearer camera."""
    stated, image, cover = board_of(scale)
    assert pose_from_markers(image, CAMERA, stated, depth_of(CAMERA, (cover,))) is NoMarkers.INCONSISTENT
    right, image, cover = board_of(1.0)
    assert isinstance(pose_from_markers(image, CAMERA, right, depth_of(CAMERA, (cover,))), MarkerPose)


def test_a_board_gives_the_pose_too():
    stated, image, _ = board_of(1.0)
    found = pose_from_markers(image, CAMERA, stated)
    assert isinstance(found, MarkerPose)
    off_m, off_rad = errors(found, CAMERA)
    assert off_m < 3.5 * found.sigma_m  # one flat board of 0.6 m at 2.3 m is a matter of centimetres, and says so
    assert off_rad < 3.5 * found.sigma_rad
    assert 0.005 < found.sigma_m < 0.02
    assert found.corners == 12


def test_infrared_of_sixteen_bits_and_colour_give_the_same_as_grey():
    grey = photo(CAMERA, SPREAD)
    plain = pose_from_markers(grey, CAMERA, layout(*SPREAD))
    infrared = (grey.astype(np.float64) ** 2 / 255.0 * 40.0).astype(np.uint16)
    colour = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    for picture in (infrared, colour):
        found = pose_from_markers(picture, CAMERA, layout(*SPREAD))
        assert isinstance(found, MarkerPose)
        np.testing.assert_allclose(found.T_world_camera, plain.T_world_camera, atol=0.004)


def test_one_small_flat_tag_is_ambiguous_or_uncertain_and_never_a_wrong_pose():
    outcomes = []
    for seed in range(6):
        only = tag(0, (0.0, 0.8, 0.0), size_m=0.2, turn=(0, 6.0 * seed - 10.0, 0))
        found = pose_from_markers(photo(CAMERA, [only], seed=seed), CAMERA, layout(only))
        outcomes.append(found if isinstance(found, NoMarkers) else None)
    assert NoMarkers.AMBIGUOUS in outcomes
    assert None not in outcomes


def test_depth_decides_between_the_two_poses_of_a_flat_tag(monkeypatch):
    for name, value in (("WORST_SIGMA_M", 0.1), ("WORST_SIGMA_RAD", 0.1), ("CORNER_SIGMA_PX", 0.5)):
        monkeypatch.setattr(markers, name, value)  # one small tag: only the two poses are at stake here
    near = camera_at((1.8, 0.8, 0.05), (0.0, 0.8, 0.0), width=512, height=424)
    only = tag(0, (0.0, 0.8, 0.0), size_m=0.2, turn=(0, 20, 0))
    grey = photo(near, [only], blur_px=0.8, noise=8.0)
    assert pose_from_markers(grey, near, layout(only)) is NoMarkers.AMBIGUOUS
    with_depth = pose_from_markers(grey, near, layout(only), depth_of(near, [only]))
    assert isinstance(with_depth, MarkerPose)
    assert errors(with_depth, near)[0] < 0.06


def test_a_tag_that_was_moved_is_left_out_and_of_two_that_disagree_neither_is_believed():
    moved = (*SPREAD[:3], tag(3, (-0.1, 0.62, 0.25)))
    found = pose_from_markers(photo(CAMERA, moved), CAMERA, layout(*SPREAD))
    assert found.left_out == (3,)
    assert errors(found, CAMERA)[0] < 0.008
    moved = (SPREAD[0], tag(2, (0.1, 1.25, 0.25), turn=(20, -25, 0)))
    found = pose_from_markers(photo(CAMERA, moved), CAMERA, layout(SPREAD[0], SPREAD[2]))
    assert found is NoMarkers.INCONSISTENT


def test_tiny_cut_and_missing_tags_are_refused(monkeypatch):
    far = tag(0, (0.0, 0.8, 0.0), size_m=0.05)
    assert pose_from_markers(photo(CAMERA, [far]), CAMERA, layout(far)) in (NoMarkers.TOO_SMALL, NoMarkers.NONE_SEEN)
    with monkeypatch.context() as stricter:
        stricter.setattr(markers, "LEAST_SIDE_PX", 60.0)
        assert pose_from_markers(photo(CAMERA, SPREAD), CAMERA, layout(*SPREAD)) is NoMarkers.TOO_SMALL
    cut = photo(CAMERA, [tag(0, (0.3, 0.9, 0.0), size_m=0.4)])
    cut[:, 256:] = 120
    assert pose_from_markers(cut, CAMERA, layout(tag(0, (0.3, 0.9, 0.0), size_m=0.4))) is NoMarkers.NONE_SEEN
    assert pose_from_markers(photo(CAMERA, ()), CAMERA, layout(*SPREAD)) is NoMarkers.NONE_SEEN
    other = photo(CAMERA, [tag(9, (0.2, 0.9, 0.0))])
    assert pose_from_markers(other, CAMERA, layout(*SPREAD)) is NoMarkers.NONE_SEEN


def test_a_tag_that_is_seen_twice_is_not_used_and_a_picture_of_another_size_refused():
    copy = tag(0, (0.2, 0.75, 0.0))
    found = pose_from_markers(photo(CAMERA, (*SPREAD, copy)), CAMERA, layout(*SPREAD))
    assert found.markers == (1, 2, 3)
    with pytest.raises(ValueError, match="an image is"):
        pose_from_markers(np.zeros((10, 10), np.uint8), CAMERA, layout(*SPREAD))


def document(**changes) -> dict:
    tags = [{"id": 4, "size_m": 0.16, "pose": np.eye(4).tolist()}]
    return {"format": "marker-layout", "version": 1, "dictionary": DICTIONARY, "tags": tags} | changes


def test_a_layout_is_read_as_it_is_written(tmp_path):
    path = tmp_path / "markers.json"
    path.write_text(json.dumps(document()))
    (only,) = read_document(path, MarkerLayout).tags
    assert (only.number, only.size_m) == (4, 0.16)
    np.testing.assert_allclose(only.corners_m()[0], [-0.08, 0.08, 0.0])
    board = {"squares_x": 5, "squares_y": 7, "square_m": 0.04, "marker_m": 0.03, "pose": np.eye(4).tolist()}
    path.write_text(json.dumps({key: value for key, value in document(board=board).items() if key != "tags"}))
    assert read_document(path, MarkerLayout).board is not None


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"dictionary": "APRILTAG_36h11"}, "did you mean DICT_APRILTAG_36h11"),
        ({"tags": []}, "list every tag once"),
        ({"tags": [{"id": 1, "size_m": 160, "pose": np.eye(4).tolist()}]}, "at most 5"),
        ({"tags": [{"id": 1, "size_m": 0.1, "pose": (2 * np.eye(4)).tolist()}]}, "is not a rigid motion"),
        ({"tags": document()["tags"] * 2}, "names an id twice"),
        ({"tags": None}, "either single tags or one board"),
        ({"tagz": []}, "did you mean 'tags'"),
        ({"version": 2}, "version is 2; it must be 1: the version that this release reads"),
    ],
)
def test_a_layout_that_cannot_be_used_is_refused_with_a_remedy(tmp_path, changes, said):
    path = tmp_path / "markers.json"
    path.write_text(json.dumps(document(**changes)))
    with pytest.raises(InputError, match=said) as refusal:
        read_document(path, MarkerLayout)
    assert "markers.json" in str(refusal.value)


def recording_with(folder, *cameras: Camera) -> Recording:
    for camera in cameras:
        (folder / camera.name).mkdir()
    nothing = (None,) * len(cameras)
    return Recording(folder=folder, cameras=cameras, streams=(), backgrounds_m=nothing, equipment=None, subject=UNKNOWN)


def test_a_camera_with_a_picture_of_the_markers_is_placed_and_the_others_keep_what_they_have(tmp_path):
    unplaced = replace(CAMERA, T_world_camera=None)
    side = replace(unplaced, name="side")
    recording = recording_with(tmp_path, unplaced, side)
    cv2.imwrite(str(tmp_path / CAMERA.name / "infrared.png"), photo(CAMERA, SPREAD))
    placed, records = place_by_markers(recording, layout(*SPREAD))
    assert np.abs(placed.cameras[0].require_pose() - CAMERA.require_pose()).max() < 0.02
    assert placed.cameras[1].T_world_camera is None
    assert list(records) == [CAMERA.name]
    assert records[CAMERA.name].source is PoseSource.MARKERS
    assert 0 < records[CAMERA.name].sigma_m < 0.02


def test_the_record_names_the_tags_that_are_left_out(tmp_path):
    recording = recording_with(tmp_path, CAMERA)
    moved = (*SPREAD[:3], tag(3, (-0.1, 0.62, 0.25)))
    cv2.imwrite(str(tmp_path / CAMERA.name / "infrared.png"), photo(CAMERA, moved))
    _, records = place_by_markers(recording, layout(*SPREAD))
    (out,) = (figure for figure in records[CAMERA.name].figures if figure.unit == "tags")
    assert (out.value, "(3)" in out.what) == (1.0, True)


def test_images_that_give_no_pose_are_refused_by_name(tmp_path):
    recording = recording_with(tmp_path, CAMERA)
    of_tags = layout(*SPREAD)
    with pytest.raises(InputError, match=r"infrared\.png or color\.png"):
        place_by_markers(recording, of_tags)
    path = tmp_path / CAMERA.name / "color.png"
    cv2.imwrite(str(path), np.full((CAMERA.height, CAMERA.width), 90, np.uint8))
    with pytest.raises(InputError, match=r"color\.png.*none of the markers"):
        place_by_markers(recording, of_tags)
    cv2.imwrite(str(path), np.full((40, 30), 90, np.uint8))
    with pytest.raises(InputError, match="30 x 40 pixels"):
        place_by_markers(recording, of_tags)
    path.write_bytes(b"no picture")
    with pytest.raises(InputError, match="not a readable image"):
        place_by_markers(recording, of_tags)
