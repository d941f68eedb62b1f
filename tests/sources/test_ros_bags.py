"""Bags of ROS drivers: depth bit for bit, device times, lens and pose, in each container and encoding."""

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags")
from bags_builder import (
    FORMATS,
    SIZE,
    Info,
    Sent,
    compressed_of,
    depth_bag,
    depth_values,
    expected,
    image_of,
    stamp_ns,
    transforms_of,
    write_bag,
)
from rosbags.highlevel import AnyReader

from anchorpose.errors import InputError
from anchorpose.sources.ros_bags import matches, open_source

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "recorder_files"
IMAGE, COMPRESSED, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
RAW = "/camera/depth/image_raw"


def frames_of(path: Path) -> tuple[Any, list[Any]]:
    source = open_source(path)
    return source, list(source.frames())


def one_image(folder: Path, build: Any, kind: str = IMAGE, topic: str = RAW, form: str = "ros1") -> tuple[Any, Any]:
    source, frames = frames_of(write_bag(folder, form, [Sent(topic, kind, 9_000_000_123, build)]))
    assert len(frames) == 1
    return source, frames[0]


@pytest.mark.parametrize("form", FORMATS)
def test_depth_times_lens_and_count_are_the_file_s_in_each_container(tmp_path: Path, form: str) -> None:
    path = depth_bag(tmp_path, form)
    head = b"" if path.is_dir() else path.read_bytes()[:4096]
    assert matches(path, head)
    source, frames = frames_of(path)
    camera = source.cameras[0]
    assert (camera.name, camera.width, camera.height, camera.count) == ("camera", SIZE[1], SIZE[0], 4)
    assert (camera.depth_scale, camera.intrinsics.fx, camera.intrinsics.cy) == (0.001, 30.0, 11.5)
    for k, frame in enumerate(frames):
        assert np.array_equal(frame.depth, expected(depth_values(k)))
        assert (frame.depth.dtype, round(frame.time_s * 1e6)) == (np.dtype("=u2"), stamp_ns(k) // 1000)
    assert source.notes == ()


def test_cdr_is_read_in_both_byte_orders(tmp_path: Path) -> None:
    source, frames = frames_of(depth_bag(tmp_path, "db3", little=False))
    assert np.array_equal(frames[2].depth, expected(depth_values(2)))
    assert source.cameras[0].intrinsics.fx == 30.0


@pytest.mark.parametrize("encoding", ["16UC1", "mono16", "Z16"])
@pytest.mark.parametrize("order", ["<u2", ">u2"])
@pytest.mark.parametrize("padding", [0, 6])
def test_whole_numbers_in_each_encoding_byte_order_and_row_length(
    tmp_path: Path, encoding: str, order: str, padding: int
) -> None:
    values = depth_values(1)
    _, frame = one_image(tmp_path, image_of(values.astype(order), encoding, 5, padding=padding))
    assert np.array_equal(frame.depth, expected(values))


@pytest.mark.parametrize("order", ["<f4", ">f4"])
def test_metres_that_are_whole_millimetres_stay_so(tmp_path: Path, order: str) -> None:
    values = (depth_values(1) % 9000 + 1).astype(np.float32) * np.float32(0.001)
    values[1, :3] = np.nan, np.inf, -1.0
    source, frame = one_image(tmp_path, image_of(values.astype(order), "32FC1", 5), form="mcap")
    wanted = np.round(np.where(np.isfinite(values) & (values > 0), values, 0) * 1000)
    assert np.array_equal(frame.depth, wanted.astype(np.uint16))
    assert source.cameras[0].depth_scale == 0.001
    assert "1 mm" in source.notes[0]


@pytest.mark.parametrize(("farthest", "scale"), [(8.0, 0.00025), (20.0, 0.0005), (40.0, 0.001)])
def test_other_metres_are_kept_as_finely_as_their_range_allows(tmp_path: Path, farthest: float, scale: float) -> None:
    values = np.random.default_rng(2).uniform(0.5, farthest, SIZE).astype(np.float32)
    values[0, 0] = farthest
    source, frame = one_image(tmp_path, image_of(values, "32FC1", 5))
    assert source.cameras[0].depth_scale == scale
    assert np.abs(frame.depth * scale - values).max() <= scale / 2 + 1e-5


def test_a_reading_beyond_the_grey_values_is_none_and_counted(tmp_path: Path) -> None:
    near, far = np.full(SIZE, 2.0003, np.float32), np.full(SIZE, 2.0003, np.float32)
    far[3, 3] = 17.0
    sent = [Sent(RAW, IMAGE, k, image_of(values, "32FC1", 5 + k)) for k, values in enumerate((near, far))]
    source, frames = frames_of(write_bag(tmp_path, "ros1", sent))
    assert frames[1].depth[3, 3] == 0
    assert "1 readings of camera are farther" in source.notes[-1]


@pytest.mark.parametrize("form", ["ros1", "db3"])
def test_compressed_depth_is_unpacked_bit_for_bit(tmp_path: Path, form: str) -> None:
    png = cv2.imencode(".png", depth_values(3))[1].tobytes()
    packed = compressed_of(bytes(12) + png, "16UC1; compressedDepth png", stamp_ns(0))
    _, frame = one_image(tmp_path, packed, COMPRESSED, f"{RAW}/compressedDepth", form)
    assert np.array_equal(frame.depth, expected(depth_values(3)))


def test_compressed_metres_are_as_exact_as_image_transport_makes_them(tmp_path: Path) -> None:
    """The formula of compressed_depth_image_transport's encoder, at its defaults: 10 m, quantization 100."""
    metres = np.random.default_rng(4).uniform(0.5, 6.0, SIZE).astype(np.float32)
    a = 100.0 * 101.0
    b = 1.0 - a / 10.0
    packed = np.round(a / metres + b).astype(np.uint16)
    packed[0, 0] = 0
    data = struct.pack("<iff", 0, a, b) + cv2.imencode(".png", packed)[1].tobytes()
    build = compressed_of(data, "32FC1; compressedDepth png", 5)
    source, frame = one_image(tmp_path, build, COMPRESSED, f"{RAW}/compressedDepth")
    given = frame.depth * source.cameras[0].depth_scale
    assert given[0, 0] == 0
    assert np.abs(given - metres).ravel()[1:].max() < 0.5 * 36.0 / a + 0.001  # half a step of 1/depth at 6 m


@pytest.mark.parametrize("encoding", ["rgb8", "16SC1"])
def test_a_bag_without_depth_says_what_it_has(tmp_path: Path, encoding: str) -> None:
    path = write_bag(tmp_path, "ros1", [Sent(RAW, IMAGE, 5, image_of(depth_values(1), encoding, 5))])
    with pytest.raises(InputError, match=encoding):
        open_source(path)
    infrared = [Sent("/camera/ir/image_raw", IMAGE, 5, image_of(depth_values(1), "mono16", 5))]
    (tmp_path / "other").mkdir()
    with pytest.raises(InputError, match="/camera/ir/image_raw"):
        open_source(write_bag(tmp_path / "other", "ros1", infrared))


def test_an_image_without_a_stamp_has_the_time_of_receipt_and_a_note(tmp_path: Path) -> None:
    source, frame = one_image(tmp_path, image_of(depth_values(1), "16UC1", 0))
    assert frame.time_s == pytest.approx(9.000000123, abs=1e-9)
    assert "no time stamp" in source.notes[-1]


def test_several_cameras_are_several_and_copies_of_one_are_left_out(tmp_path: Path) -> None:
    topics = {
        "/left/depth/image_raw": "16UC1",
        "/left/aligned_depth_to_color/image_raw": "16UC1",
        "/left/depth/image_rect_raw": "16UC1",
        "/left/depth/image": "32FC1",
        "/right/depth_registered/image_raw": "16UC1",
        "/kinect2/sd/image_depth_rect": "16UC1",
        "/kinect2/hd/image_depth_rect": "16UC1",
    }
    sent = [
        Sent(topic, IMAGE, k, image_of(depth_values(k).astype({"32FC1": "f4"}.get(encoding, "u2")), encoding, 5))
        for k, (topic, encoding) in enumerate(topics.items())
    ]
    source, frames = frames_of(write_bag(tmp_path, "mcap", sent))
    assert ([camera.name for camera in source.cameras], len(frames)) == (["kinect2", "left", "right"], 3)
    chosen = {source.cameras[frame.camera].name: frame.depth for frame in frames}
    assert np.array_equal(chosen["left"], expected(depth_values(0)))
    assert np.array_equal(chosen["kinect2"], expected(depth_values(5)))
    assert sum("is left out" in note for note in source.notes) == 4


@pytest.mark.parametrize("info", [Info(), Info(frame="other"), Info(width=64, height=48)])
def test_an_info_elsewhere_belongs_by_its_frame_and_size(tmp_path: Path, info: Info) -> None:
    sent = [Sent("/rgb/camera_info", INFO, 3, info), Sent(RAW, IMAGE, 4, image_of(depth_values(0), "16UC1", 5))]
    source = open_source(write_bag(tmp_path, "db3", sent))
    if info == Info():
        assert source.cameras[0].intrinsics.fx == 30.0
    else:
        assert source.cameras[0].intrinsics is None
        assert "--intrinsics" in source.notes[0]


def test_static_transforms_from_the_world_place_the_camera(tmp_path: Path) -> None:
    """Two metres in front of the map's origin and 1.5 m above, looking back along -x: x right is then +y of ROS."""
    to_camera = (2.0, 0.0, 1.5, -0.5, -0.5, 0.5, 0.5)  # optical z is -x of the map, y is down
    rows = [("map", "tripod", (0, 0, 0, 0, 0, 0, 1.0)), ("tripod", "optical", to_camera)]
    T = placed_source(tmp_path, "/tf_static", rows).cameras[0].T_world_camera
    np.testing.assert_allclose(T[:3, 3], [2.0, 1.5, 0.0], atol=1e-12)  # y is up
    np.testing.assert_allclose(T[:3, :3] @ [0, 1, 0], [0, -1, 0], atol=1e-12)  # down
    np.testing.assert_allclose(T[:3, :3] @ [0, 0, 1], [-1, 0, 0], atol=1e-12)  # towards the origin
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def placed_source(folder: Path, topic: str, rows: list) -> Any:
    transforms = Sent(topic, "tf2_msgs/msg/TFMessage", 1, transforms_of(rows))
    return open_source(
        write_bag(folder, "db3", [transforms, Sent(RAW, IMAGE, 4, image_of(depth_values(0), "16UC1", 5))])
    )


@pytest.mark.parametrize(("topic", "top"), [("/tf", "map"), ("/tf_static", "base_link")])
def test_a_robot_or_moving_transforms_are_no_world(tmp_path: Path, topic: str, top: str) -> None:
    source = placed_source(tmp_path, topic, [(top, "optical", (1.0, 0, 0, 0, 0, 0, 1.0))])
    assert source.cameras[0].T_world_camera is None
    assert any("pose is not known" in note for note in source.notes)


@pytest.mark.parametrize("name", ["ros1_person_1.bag", "ros1_person_2.bag"])
def test_real_bags_equal_what_rosbags_and_numpy_decode(name: str) -> None:
    path = DATA / name
    if not path.is_file():
        pytest.skip(f"{path} is not here")
    source, frames = frames_of(path)
    with AnyReader([path]) as reader:
        wanted = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages() if "depth" in c.topic]
    assert len(frames) == len(wanted) == 1
    metres = np.frombuffer(wanted[0].data.tobytes(), "<f4").reshape(480, 640).astype(float)
    millimetres = np.round(np.nan_to_num(metres) * 1000)
    assert np.array_equal(frames[0].depth, millimetres.astype(np.uint16))
    stamp = wanted[0].header.stamp
    assert frames[0].time_s == pytest.approx(stamp.sec + stamp.nanosec * 1e-9, abs=1e-6)
    assert source.cameras[0].intrinsics.distortion[4] == pytest.approx(-0.49247294)
