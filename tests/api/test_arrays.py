"""Depth images in memory become the recording that files would be, and what does not fit is refused in one sentence."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recording_builder import write_recording

import anchorpose
from anchorpose.api.arrays import DepthImages, grey_of
from anchorpose.recording.reader import open_recording, read_frame

CAMERA = anchorpose.Camera(
    name="front",
    width=32,
    height=24,
    depth_scale=0.001,
    intrinsics=anchorpose.Intrinsics(fx=30.0, fy=30.0, cx=16.0, cy=12.0),
    T_world_camera=np.eye(4),
)
DEPTH = np.linspace(1.0, 4.0, 3 * 24 * 32).reshape(3, 24, 32)
WHOLE = DepthImages(cameras=(CAMERA,), depth_m={"front": DEPTH}, time_s=np.array([0.0, 0.1, 0.2]))


def test_images_and_times_are_those_that_were_given(tmp_path):
    side = replace(CAMERA, name="side")
    two = DepthImages(
        cameras=(CAMERA, side),
        depth_m={"front": DEPTH, "side": DEPTH[::-1]},
        time_s={"front": np.array([0.0, 0.1, 0.2]), "side": np.array([0.01, 0.11, 0.21])},
        subject=anchorpose.Subject(height_m=1.7, missing=("hand_left",)),
        empty_room_m={"side": np.full((24, 32), 4.5)},
    )
    recording = open_recording(two.write(tmp_path))
    assert recording.subject == two.subject
    assert recording.backgrounds_m[0] is None
    np.testing.assert_allclose(recording.backgrounds_m[1], 4.5)
    np.testing.assert_allclose(recording.streams[1].time_s, [0.01, 0.11, 0.21])
    for frame in range(3):
        front, beside = read_frame(recording, frame).depths_m
        np.testing.assert_allclose(front, DEPTH[frame], atol=0.0005)
        np.testing.assert_allclose(beside, DEPTH[2 - frame], atol=0.0005)


@pytest.mark.parametrize("kind", [Path, str])
def test_equipment_is_that_of_the_file(tmp_path, kind):
    given = open_recording(write_recording(tmp_path / "given"))
    (tmp_path / "own").mkdir()
    equipment = tmp_path / "given" / "equipment.json"
    recording = open_recording(replace(WHOLE, equipment=kind(equipment)).write(tmp_path / "own"))
    assert [part.name for part in recording.equipment.parts] == [part.name for part in given.equipment.parts]


def test_numbers_of_arrays_and_data_frames_are_numbers(tmp_path):
    lens = anchorpose.Intrinsics(
        fx=np.float32(30.0), fy=np.float32(30.0), cx=np.float32(16.0), cy=np.array(12.0), distortion=np.zeros(5)
    )
    pose = np.eye(4, dtype=np.float32)
    pose[:3, 3] = (0.5, 1.25, -2.0)
    camera = anchorpose.Camera(
        name="front",
        width=np.int64(32),
        height=np.uint16(24),
        depth_scale=np.float64(0.001),
        intrinsics=lens,
        T_world_camera=[list(row) for row in pose],
    )
    subject = anchorpose.Subject(
        height_m=np.float64(1.75), birth_year=np.int64(1950), missing=np.array(["hand_left", "foot_left"])
    )
    recording = open_recording(replace(WHOLE, cameras=(camera,), subject=subject).write(tmp_path))
    (found,) = recording.cameras
    assert found.intrinsics == CAMERA.intrinsics
    assert (found.width, found.height, found.depth_scale) == (32, 24, 0.001)
    np.testing.assert_array_equal(found.T_world_camera, pose)
    assert recording.subject == anchorpose.Subject(height_m=1.75, birth_year=1950, missing=("hand_left", "foot_left"))
    with pytest.raises(anchorpose.AnchorposeError, match=r"give \(24, 32\)"):
        grey_of(DEPTH[0, :10], camera)


def test_no_reading_is_zero_in_a_file():
    depth = DEPTH[0].copy()
    depth[0, :4] = (0.0, np.nan, np.inf, -np.inf)
    grey = grey_of(depth, CAMERA)
    assert grey.dtype == np.uint16
    assert grey[0, :4].tolist() == [0, 0, 0, 0]
    assert grey[0, 4] == round(1000 * depth[0, 4])


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"depth_m": {}}, "front has no depth images; give"),
        ({"time_s": {}}, "front has no times; give"),
        ({"depth_m": {"front": DEPTH, "Side": DEPTH}}, "camera Side is unknown; name one of front"),
        ({"time_s": {"front": np.arange(3.0), "Side": np.arange(3.0)}}, "camera Side is unknown; name one of front"),
        ({"empty_room_m": {"Front": DEPTH[0]}}, "camera Front is unknown; name one of front"),
        ({"cameras": (replace(CAMERA, T_world_camera=[[1.0, 0.0], [0.0]]),)}, "four rows of four numbers"),
        ({"time_s": np.array([0.0, 0.1])}, "3 depth images and 2 times; give one"),
        ({"time_s": np.array([0.0, 0.1, 0.1])}, "do not rise at 0.1 s; sort"),
        ({"depth_m": {"front": DEPTH[:, :20]}}, r"shape \(20, 32\); give \(24, 32\)"),
        ({"depth_m": {"front": DEPTH * 1000.0}}, "65.535 m is the most; give depth in metres"),
        ({"depth_m": {"front": -DEPTH}}, "negative depth readings; give metres"),
        ({"cameras": (CAMERA, CAMERA)}, "two cameras named 'front'; give each"),
        ({"cameras": (replace(CAMERA, width=0),)}, "width"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, change, sentence):
    with pytest.raises(anchorpose.AnchorposeError, match=sentence):
        replace(WHOLE, **change).write(tmp_path)
