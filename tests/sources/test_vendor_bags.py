"""RealSense's and Orbbec's own recordings, written here after the layout of their public SDK sources."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags")
from backports import zstd
from bags_builder import (
    ROS1,
    ROS2,
    SIZE,
    Info,
    Sent,
    compressed_of,
    depth_values,
    expected,
    image_of,
    write_bag,
)

from anchorpose.errors import InputError
from anchorpose.lens import LensModel
from anchorpose.sources.ros_bags import open_source

IMAGE, TEXT, PAIR = "sensor_msgs/msg/Image", "std_msgs/msg/String", "diagnostic_msgs/msg/KeyValue"
SENSOR = "/device_0/sensor_0"
DEPTH = f"{SENSOR}/Depth_0"
TIMES_NS = (1_000_125_000, 1_033_458_000, 1_066_791_000)  # the device's, where the recorder's begin at 0
UNIT = struct.pack("<f", 0.00025)
INVERSE = (0.1, 0.2, 0.0, 0.0, 0.0)


def pair(topic: str, key: str, value: str) -> Sent:
    return Sent(topic, PAIR, 1, ROS1.types[PAIR](key=key, value=value))


def text(topic: str, value: str, received_ns: int = 0) -> Sent:
    return Sent(topic, TEXT, received_ns, ROS2.types[TEXT](data=value))


def realsense_bag(
    folder: Path, form: str = "ros1", *, model: str = "Brown Conrady", D: Any = (0.0,) * 5, old: bool = False
) -> Path:
    """As librealsense 2.56 writes it: the image's frame is "1", and its depth unit follows; in old bags neither."""
    info = Info(model=model, D=D, P=(0.0,) * 12, frame="")
    sent = [
        Sent(f"{DEPTH}/info/camera_info", "sensor_msgs/msg/CameraInfo", 1, info),
        pair("/device_0/info", "Name", "Intel RealSense D455"),
        pair("/device_0/info", "Serial Number", "123456"),
    ]
    for k, time_ns in enumerate(TIMES_NS):
        image = image_of(depth_values(k), "mono16", time_ns, frame="0" if old else "1")
        plain = bytes(ROS1.serialize_ros1(image(ROS1), IMAGE))
        received = 500 + k * 30_000_000
        sent.append(Sent(f"{DEPTH}/image/data", IMAGE, received, plain if old else plain + UNIT))
        sent.append(pair(f"{DEPTH}/image/metadata", "system_time", "0.0"))
    if old:
        sent.append(Sent(f"{SENSOR}/option/Depth_Units/value", "std_msgs/msg/Float32", 1, UNIT))
    return write_bag(folder, form, sent)


def realsense_database(
    folder: Path, packing: str = "", *, without: int | None = None, units: bool = True, broken: int | None = None
) -> Path:
    """As librealsense 2.58 and 2.59 write it; packing: "zstd" packs each message, "png" the images."""
    lens = "width=32;height=24;fx=30;ppx=15.5;fy=31;ppy=11.5;model=Brown Conrady;coeffs=0,0,0,0,0"
    sent = [
        text(f"{DEPTH}/camera_info", lens),
        text("/device_0/info", "Name=Intel RealSense D455;Serial Number=123456"),
    ]
    if units:
        sent.append(text(f"{SENSOR}/option/Depth_Units/value", "0.000250"))
    for k, time_ns in enumerate(TIMES_NS):
        received = 500 + k * 30_000_000
        image = _database_image(k, received, packing)
        sent.append(replace(image, value=bytes(8)) if k == broken else image)
        if k != without:
            stamp = f"Frame number={k};timestamp_domain=Hardware Clock;timestamp={time_ns / 1e6:.6f};"
            sent.append(text(f"{DEPTH}/image/metadata", stamp, received))
    if packing == "zstd":
        sent = [
            Sent(s.topic, s.kind, s.received_ns, zstd.compress(bytes(ROS2.serialize_cdr(_built(s), s.kind))))
            for s in sent
        ]
    return write_bag(folder, "db3", sent)


def _built(sent: Sent) -> Any:
    return sent.value(ROS2) if callable(sent.value) else sent.value


def _database_image(k: int, received_ns: int, packing: str) -> Sent:
    topic = f"{DEPTH}/image/data"
    if packing == "png":
        data = bytes(12) + cv2.imencode(".png", depth_values(k))[1].tobytes()
        build = compressed_of(data, "16UC1; compressedDepth png", received_ns, "Depth")
        return Sent(f"{topic}/compressedDepth", "sensor_msgs/msg/CompressedImage", received_ns, build)
    return Sent(topic, IMAGE, received_ns, image_of(depth_values(k), "mono16", received_ns, frame="Depth"))


def check_realsense(path: Path, kept: tuple[int, ...] = (0, 1, 2)) -> Any:
    source = open_source(path)
    camera = source.cameras[0]
    assert (camera.name, camera.model, camera.serial) == ("realsense", "Intel RealSense D455", "123456")
    assert camera.depth_scale == 0.00025
    assert (camera.width, camera.height, camera.count) == (SIZE[1], SIZE[0], 3)
    frames = list(source.frames([0]))
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


def test_realsense_without_a_depth_unit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="depth unit"):
        open_source(realsense_database(tmp_path, units=False))


def test_a_realsense_lens_that_undistorts_is_named_and_not_taken(tmp_path: Path) -> None:
    source = open_source(realsense_bag(tmp_path, model="Inverse Brown Conrady", D=INVERSE))
    assert source.cameras[0].intrinsics is None
    assert "Inverse Brown Conrady" in source.notes[0]


def test_a_realsense_fisheye_has_four_coefficients(tmp_path: Path) -> None:
    source = open_source(realsense_bag(tmp_path, model="Kannala Brandt4", D=INVERSE))
    assert source.cameras[0].intrinsics.model is LensModel.KANNALA_BRANDT
    assert source.cameras[0].intrinsics.distortion == INVERSE[:4]


ORBBEC_IMAGE = "/cam/sensor_3/frameType_3"
LENS = (0.5, -0.2, 0.01, 0.3, -0.1, 0.02, 0.001, 0.002)  # k1 to k6, p1, p2


def orbbec_header() -> bytes:
    return struct.pack("<III", 0, 0, 0) + struct.pack("<I", 0)


def orbbec_texts(*texts: str) -> bytes:
    return b"".join(struct.pack("<I", len(t)) + t.encode() for t in texts)


def orbbec_property(number: int, data: bytes) -> Sent:
    value = orbbec_header() + struct.pack("<II", number, len(data)) + data + struct.pack("<I", len(data))
    return Sent("/cam/property", "custom_msg/msg/OBProperty", 2, value, "uint8 propertyId\n")


def orbbec_bag(folder: Path, *more: Sent, model: int = 4, ended: bool = True) -> Path:
    """After RosbagWriter.cpp of OrbbecSDK_v2; its embedded definitions are not what the messages have."""
    sent = []
    for k, time_ns in enumerate(TIMES_NS):
        plain = ROS1.serialize_ros1(image_of(depth_values(k), "mono16", time_ns, frame="")(ROS1), IMAGE)
        tail = struct.pack("<fQQQQ", 0.0, k, time_ns // 1000, 5, 6) + struct.pack("<I", 3) + b"abc" + b"\0\0\0\0\x10"
        sent.append(Sent(ORBBEC_IMAGE, IMAGE, time_ns, bytes(plain) + tail))
    sent += more
    if ended:
        lens = orbbec_header() + struct.pack("<BB12f3H", 3, 28, *[0.0] * 12, SIZE[1], SIZE[0], 30)
        lens += struct.pack("<4f8fB", 30.0, 31.0, 15.5, 11.5, *LENS, model)
        about = orbbec_header() + orbbec_texts("Femto Bolt", "Orbbec Femto Bolt", "MX") + struct.pack("<HH", 1, 2)
        about += (
            orbbec_texts("1-2", "CL8H", "1.0", "2.0", "1", "USB3") + struct.pack("<HB", 0, 0) + orbbec_texts("", "")
        )
        sent.append(Sent("/cam/streamProfileType_3", "custom_msg/msg/OBStreamProfileInfo", 9, lens, "uint8 format\n"))
        sent.append(Sent("/cam/deviceInfo", "custom_msg/msg/OBDeviceInfo", 9, about, "string name\n"))
    return write_bag(folder, "ros1", sent)


def test_an_orbbec_bag_has_its_device_s_times_lens_and_unit(tmp_path: Path) -> None:
    source = open_source(orbbec_bag(tmp_path, orbbec_property(75, struct.pack("<i", 5))))
    camera = source.cameras[0]
    assert (camera.name, camera.model, camera.serial, camera.depth_scale) == ("orbbec", "Femto Bolt", "CL8H", 0.0005)
    k1, k2, k3, k4, k5, k6, p1, p2 = LENS
    assert camera.intrinsics.model is LensModel.RATIONAL
    assert camera.intrinsics.distortion == pytest.approx((k1, k2, p1, p2, k3, k4, k5, k6), rel=1e-6)
    assert (camera.intrinsics.fy, camera.intrinsics.cx) == (31.0, 15.5)
    frames = list(source.frames([0]))
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


def test_orbbec_without_unit_or_lens_says_so(tmp_path: Path) -> None:
    source = open_source(orbbec_bag(tmp_path, ended=False))
    assert source.cameras[0].intrinsics is None
    assert "no depth unit" in source.notes[0]
    assert "--intrinsics" in source.notes[1]


def test_an_orbbec_lens_of_another_model_is_named_and_not_taken(tmp_path: Path) -> None:
    source = open_source(orbbec_bag(tmp_path, model=2))
    assert source.cameras[0].intrinsics is None
    assert "Orbbec's number 2" in source.notes[-1]
