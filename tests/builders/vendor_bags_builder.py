"""RealSense's and Orbbec's own recordings, written after the layout of their public SDK sources."""

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
from backports import zstd
from bags_builder import ROS1, ROS2, SIZE, Info, Sent, compressed_of, depth_values, image_of, write_bag

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


ORBBEC_IMAGE = "/cam/sensor_3/frameType_3"
LENS = (0.5, -0.2, 0.01, 0.3, -0.1, 0.02, 0.001, 0.002)  # k1 to k6, p1, p2


def orbbec_header() -> bytes:
    return struct.pack("<III", 0, 0, 0) + struct.pack("<I", 0)


def orbbec_texts(*texts: str) -> bytes:
    return b"".join(struct.pack("<I", len(t)) + t.encode() for t in texts)


def orbbec_property(number: int, data: bytes) -> Sent:
    value = orbbec_header() + struct.pack("<II", number, len(data)) + data + struct.pack("<I", len(data))
    return Sent("/cam/property", "custom_msg/msg/OBProperty", 2, value, "uint8 propertyId\n")


def _orbbec_image(k: int, time_ns: int) -> bytes:
    plain = bytes(ROS1.serialize_ros1(image_of(depth_values(k), "mono16", time_ns, frame="")(ROS1), IMAGE))
    return (
        plain + struct.pack("<fQQQQ", 0.0, k, time_ns // 1000, 5, 6) + struct.pack("<I", 3) + b"abc" + b"\0\0\0\0\x10"
    )


def _orbbec_image_2_3(k: int, time_ns: int) -> bytes:
    """As the sources of version 2.3.5 have it: metadata before the pixels, and their length before both."""
    data = b"metadata" + depth_values(k).tobytes()
    head = orbbec_header() + struct.pack("<II", *SIZE) + orbbec_texts("mono16") + struct.pack("<BI", 0, 2 * SIZE[1])
    return head + struct.pack("<II", 8, len(data)) + data + struct.pack("<QQQQ", k, time_ns // 1000, 5, 6)


def orbbec_bag(folder: Path, *more: Sent, model: int = 4, ended: bool = True, sdk: str = "2.4") -> Path:
    """After RosbagWriter.cpp and Image.h of OrbbecSDK_v2; its embedded definitions are not what the messages have."""
    image = _orbbec_image_2_3 if sdk == "2.3" else _orbbec_image
    sent = [Sent(ORBBEC_IMAGE, IMAGE, time_ns, image(k, time_ns)) for k, time_ns in enumerate(TIMES_NS)]
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
