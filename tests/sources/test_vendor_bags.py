"""RealSense's and Orbbec's own recordings."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
from bags_builder import ROS1, SIZE, Sent, depth_values, expected, image_of, write_bag
from vendor_bags_builder import (
    INVERSE,
    LENS,
    TIMES_NS,
    orbbec_bag,
    orbbec_header,
    orbbec_property,
    realsense_bag,
    realsense_database,
)

from anchorpose.errors import InputError
from anchorpose.lens import LensModel
from anchorpose.options import ConvertOptions
from anchorpose.sources.plan import make_plan
from anchorpose.sources.ros_bags import open_source


def check_realsense(path: Path, kept: tuple[int, ...] = (0, 1, 2)) -> Any:
    source = open_source(path)
    camera = source.cameras[0]
    assert (camera.name, camera.model, camera.serial) == ("realsense", "Intel RealSense D455", "123456")
    assert camera.depth_scale == 0.00025
    assert (camera.width, camera.height, camera.count) == (SIZE[1], SIZE[0], 3)
    frames = list(source.frames())
    assert [round(frame.time_s * 1e9) for frame in frames] == [TIMES_NS[k] for k in kept]
    for k, frame in zip(kept, frames, strict=True):
        assert np.array_equal(frame.depth, expected(depth_values(k)))
    return source


@pytest.mark.parametrize("form", ["ros1", "ros1-lz4"])
@pytest.mark.parametrize("old", [False, True])
def test_a_realsense_bag_has_the_unit_of_its_images_or_of_its_sensor(tmp_path: Path, form: str, old: bool) -> None:
    source = check_realsense(realsense_bag(tmp_path, form, old=old))
    assert source.cameras[0].intrinsics.fy == 31.0
    assert source.notes == ()


@pytest.mark.parametrize("packing", ["", "zstd", "png"])
def test_a_realsense_database_has_the_device_s_time_and_not_the_recorder_s(tmp_path: Path, packing: str) -> None:
    source = check_realsense(realsense_database(tmp_path, packing))
    assert (source.cameras[0].intrinsics.fx, source.cameras[0].intrinsics.cy) == (30.0, 11.5)
    assert source.notes == ()


@pytest.mark.parametrize("without", [0, 1, 2])
def test_an_image_without_its_time_stamp_is_left_out(tmp_path: Path, without: int) -> None:
    kept = tuple(k for k in range(3) if k != without)
    source = check_realsense(realsense_database(tmp_path, without=without), kept)
    assert source.notes == ("1 depth images of realsense are damaged: left out.",)


def test_an_image_never_takes_the_time_stamp_of_another(tmp_path: Path) -> None:
    """The second image has lost its time stamp, and the third time stamp its image."""
    check_realsense(realsense_database(tmp_path, without=1, broken=2), (0,))


def test_realsense_without_a_depth_unit_is_refused_and_a_lens_that_undistorts_not_taken(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="depth unit"):
        open_source(realsense_database(tmp_path, units=False))
    source = open_source(realsense_bag(tmp_path, model="Inverse Brown Conrady", D=INVERSE))
    assert source.cameras[0].intrinsics is None
    assert "Inverse Brown Conrady" in source.notes[0]


def test_a_realsense_fisheye_has_four_coefficients(tmp_path: Path) -> None:
    source = open_source(realsense_bag(tmp_path, model="Kannala Brandt4", D=INVERSE))
    assert source.cameras[0].intrinsics.model is LensModel.KANNALA_BRANDT
    assert source.cameras[0].intrinsics.distortion == INVERSE[:4]


@pytest.mark.parametrize("sdk", ["2.3", "2.4"])
def test_an_orbbec_bag_has_its_device_s_times_lens_and_unit(tmp_path: Path, sdk: str) -> None:
    source = open_source(orbbec_bag(tmp_path, orbbec_property(75, struct.pack("<i", 5)), sdk=sdk))
    camera = source.cameras[0]
    assert (camera.name, camera.model, camera.serial, camera.depth_scale) == ("orbbec", "Femto Bolt", "CL8H", 0.0005)
    k1, k2, k3, k4, k5, k6, p1, p2 = LENS
    assert camera.intrinsics.model is LensModel.RATIONAL
    assert camera.intrinsics.distortion == pytest.approx((k1, k2, p1, p2, k3, k4, k5, k6), rel=1e-6)
    assert (camera.intrinsics.fy, camera.intrinsics.cx) == (31.0, 15.5)
    frames = list(source.frames())
    assert [round(frame.time_s * 1e6) for frame in frames] == [time_ns // 1000 for time_ns in TIMES_NS]
    assert all(np.array_equal(f.depth, expected(depth_values(k))) for k, f in enumerate(frames))
    assert source.notes == ()


def test_an_orbbec_unit_in_millimetres_is_taken_before_the_level(tmp_path: Path) -> None:
    more = orbbec_property(75, struct.pack("<i", 0)), orbbec_property(176, struct.pack("<f", 0.1))
    assert open_source(orbbec_bag(tmp_path, *more)).cameras[0].depth_scale == 0.0001


def test_orbbec_s_disparity_is_refused_and_depth_of_the_same_camera_is_not(tmp_path: Path) -> None:
    disparity = Sent("/cam/disparityParam", "custom_msg/msg/OBDisparityParam", 2, orbbec_header(), "float64 zpd\n")
    with pytest.raises(InputError, match="disparity and not depth"):
        open_source(orbbec_bag(tmp_path, disparity, orbbec_property(85, b"\0")))
    (tmp_path / "depth").mkdir()
    assert open_source(orbbec_bag(tmp_path / "depth", disparity, orbbec_property(85, b"\1"))).cameras


def test_orbbec_without_unit_or_with_a_lens_of_another_model_says_so(tmp_path: Path) -> None:
    source = open_source(orbbec_bag(tmp_path, ended=False))
    assert source.cameras[0].intrinsics is None
    assert "no depth unit" in source.notes[0]
    assert "--intrinsics" in source.notes[1]
    (tmp_path / "other").mkdir()
    source = open_source(orbbec_bag(tmp_path / "other", model=2))
    assert source.cameras[0].intrinsics is None
    assert "Orbbec's number 2" in source.notes[-1]


def test_orbbec_s_first_sdk_is_refused_by_its_definitions(tmp_path: Path) -> None:
    """Its images would pass for a ROS driver's in millimetres, which nothing in the file states."""
    image = bytes(ROS1.serialize_ros1(image_of(depth_values(0), "mono16", 5)(ROS1), "sensor_msgs/msg/Image"))
    definition = "Header header\nuint32 height\nuint32 width\nuint64_t timestamp_usec\n"
    sent = Sent("/cam0/depth_raw", "sensor_msgs/msg/Image", 5, image, definition)
    with pytest.raises(InputError, match=r"SDK 1, whose format is not published; .* 16-bit PNG"):
        open_source(write_bag(tmp_path, "ros1", [sent]))


def test_a_device_name_ends_at_its_null_character(tmp_path):
    """Vendors' programs end a text there; recording.json cannot hold the character."""
    bag = realsense_bag(tmp_path)
    assert b"Intel RealSense D455" in bag.read_bytes()
    bag.write_bytes(bag.read_bytes().replace(b"Intel RealSense D455", b"Intel RealSense D4\0\0"))
    ((camera,),) = make_plan([open_source(bag)], ConvertOptions()).cameras
    assert camera.document()["model"] == "Intel RealSense D4"
