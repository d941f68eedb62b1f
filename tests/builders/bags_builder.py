"""Bags written by the library rosbags with the published message definitions, as tests of readers need them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)
for _store in (ROS1, ROS2):
    _store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
FORMATS = ("ros1", "ros1-lz4", "ros1-bz2", "db3", "db3-zstd", "db3-folder", "mcap", "mcap-zstd")
SIZE = (24, 32)  # rows and columns of all images here


@dataclass(frozen=True, slots=True)
class Sent:
    """A message to write; value: rosbags' message, or bytes that are written as they are."""

    topic: str
    kind: str  # "sensor_msgs/msg/Image"
    received_ns: int
    value: Any
    definition: str | None = None  # of types that ROS has not


def write_bag(folder: Path, form: str, messages: Iterable[Sent], *, little: bool = True) -> Path:
    """A bag of the form in a folder; its path, as a user would name it. little: the byte order of CDR."""
    if form.startswith("ros1"):
        return _write_ros1(folder / "recorded.bag", form.partition("-")[2], messages)
    return _write_ros2(folder / "recorded", form, messages, little)


def _write_ros1(path: Path, packing: str, messages: Iterable[Sent]) -> Path:
    writer = rosbag1.Writer(path)
    if packing:
        writer.set_compression(getattr(writer.CompressionFormat, packing.upper()))
    with writer:
        _write(writer, messages, ROS1, ROS1.serialize_ros1)
    return path


def _write_ros2(folder: Path, form: str, messages: Iterable[Sent], little: bool) -> Path:
    plugin = rosbag2.StoragePlugin.MCAP if "mcap" in form else rosbag2.StoragePlugin.SQLITE3
    writer = rosbag2.Writer(folder, version=8, storage_plugin=plugin)
    if "zstd" in form:
        mode = rosbag2.CompressionMode.STORAGE if "mcap" in form else rosbag2.CompressionMode.MESSAGE
        writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
    with writer:
        _write(writer, messages, ROS2, lambda value, kind: ROS2.serialize_cdr(value, kind, little_endian=little))
    return folder if form == "db3-folder" else next(p for p in folder.iterdir() if p.suffix in (".db3", ".mcap"))


def _write(writer: Any, messages: Iterable[Sent], store: Any, serialize: Callable[[Any, str], Any]) -> None:
    connections: dict[str, Any] = {}
    for sent in messages:
        if sent.topic not in connections:
            given = {} if sent.definition is None else {"msgdef": sent.definition, "md5sum": "0" * 32}
            connections[sent.topic] = writer.add_connection(sent.topic, sent.kind, **(given or {"typestore": store}))
        value = sent.value
        raw = value if isinstance(value, bytes) else serialize(value(store) if callable(value) else value, sent.kind)
        writer.write(connections[sent.topic], sent.received_ns, raw)


def header(store: Any, stamp_ns: int, frame: str) -> Any:
    """``std_msgs/Header``, which has a number in ROS 1 only."""
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    number = {"seq": 7} if "seq" in types["std_msgs/msg/Header"].__annotations__ else {}
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **number)


def image_of(values: np.ndarray, encoding: str, stamp_ns: int, *, frame: str = "optical", padding: int = 0) -> Any:
    """A function from a type store to ``sensor_msgs/Image``; values: (rows, columns) in the byte order to write."""
    rows, columns = values.shape
    raw = values.view(np.uint8).reshape(rows, -1)
    padded = np.hstack([raw, np.full((rows, padding), 0xAB, np.uint8)])
    big = values.dtype.byteorder == ">"

    def build(store: Any) -> Any:
        return store.types["sensor_msgs/msg/Image"](
            header=header(store, stamp_ns, frame),
            height=rows,
            width=columns,
            encoding=encoding,
            is_bigendian=int(big),
            step=padded.shape[1],
            data=padded.ravel(),
        )

    return build


def compressed_of(data: bytes, encoding: str, stamp_ns: int, frame: str = "optical") -> Any:
    """A function from a type store to ``sensor_msgs/CompressedImage``."""

    def build(store: Any) -> Any:
        return store.types["sensor_msgs/msg/CompressedImage"](
            header=header(store, stamp_ns, frame), format=encoding, data=np.frombuffer(data, np.uint8)
        )

    return build


@dataclass(frozen=True, slots=True)
class Info:
    """``sensor_msgs/CameraInfo``, by the names that ROS 1 gives its fields."""

    model: str = "plumb_bob"
    D: tuple[float, ...] = (0.0,) * 5
    K: tuple[float, ...] = (30.0, 0, 15.5, 0, 31.0, 11.5, 0, 0, 1)
    P: tuple[float, ...] = (28.0, 0, 15.0, 0, 0, 29.0, 11.0, 0, 0, 0, 1, 0)
    width: int = SIZE[1]
    height: int = SIZE[0]
    binning: tuple[int, int] = (0, 0)
    roi: tuple[int, int, int, int] = (0, 0, 0, 0)
    frame: str = "optical"

    def __call__(self, store: Any) -> Any:
        upper = "K" in store.types["sensor_msgs/msg/CameraInfo"].__annotations__
        arrays = {"D": self.D, "K": self.K, "R": (1, 0, 0, 0, 1, 0, 0, 0, 1), "P": self.P}
        named = {(n if upper else n.lower()): np.array(v, np.float64) for n, v in arrays.items()}
        column, row, height, width = self.roi
        region = store.types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=column, y_offset=row, height=height, width=width, do_rectify=False
        )
        return store.types["sensor_msgs/msg/CameraInfo"](
            header=header(store, 5, self.frame),
            height=self.height,
            width=self.width,
            distortion_model=self.model,
            binning_x=self.binning[0],
            binning_y=self.binning[1],
            roi=region,
            **named,
        )


def transforms_of(rows: list[tuple[str, str, tuple[float, ...]]]) -> Any:
    """A function to ``tf2_msgs/TFMessage``; rows: parent, child, translation with quaternion."""

    def build(store: Any) -> Any:
        t = store.types
        return t["tf2_msgs/msg/TFMessage"](
            transforms=[
                t["geometry_msgs/msg/TransformStamped"](
                    header=header(store, 5, parent),
                    child_frame_id=child,
                    transform=t["geometry_msgs/msg/Transform"](
                        translation=t["geometry_msgs/msg/Vector3"](*values[:3]),
                        rotation=t["geometry_msgs/msg/Quaternion"](*values[3:]),
                    ),
                )
                for parent, child, values in rows
            ]
        )

    return build


def depth_values(number: int) -> np.ndarray:
    """(24, 32) uint16 that no other image has, with 0 and 65535 among them."""
    values = np.random.default_rng(number).integers(400, 6000, SIZE).astype(np.uint16)
    values[0, :4] = 0, NO_READING, 1, NO_READING - 1
    return values


NO_READING = 65535


def expected(values: np.ndarray) -> np.ndarray:
    """What a reader gives of grey values."""
    return np.where(values == NO_READING, 0, values).astype(np.uint16)


def depth_bag(folder: Path, form: str, count: int = 4, info: Info | None = None, **more: Any) -> Path:
    """Millimetres of one camera at 30 Hz, with its lens."""
    topic = "/camera/depth"
    messages = [Sent(f"{topic}/camera_info", "sensor_msgs/msg/CameraInfo", 10, info or Info())]
    for k in range(count):
        stamp = stamp_ns(k)
        image = image_of(depth_values(k), "16UC1", stamp)
        messages.append(Sent(f"{topic}/image_raw", "sensor_msgs/msg/Image", stamp + 5_000_000, image))
    return write_bag(folder, form, messages, **more)


def stamp_ns(k: int) -> int:
    """The device's time of image k: no round number of microseconds in binary."""
    return 1_700_000_000_123_457_000 + k * 33_333_000


def rich_bag(folder: Path, form: str) -> Path:
    """Everything that a reader of ROS drivers' bags looks at."""
    sent = [
        Sent("/tf_static", "tf2_msgs/msg/TFMessage", 1, transforms_of([("map", "optical", (1.0, 0, 0, 0, 0, 0, 1.0))])),
        Sent("/camera/depth/camera_info", "sensor_msgs/msg/CameraInfo", 2, Info()),
    ]
    for k in range(4):
        for topic, encoding, values in (
            ("camera", "16UC1", depth_values(k)),
            ("second", "32FC1", depth_values(k) / 1e3),
        ):
            image = image_of(values.astype("f4" if encoding == "32FC1" else "u2"), encoding, stamp_ns(k))
            sent.append(Sent(f"/{topic}/depth/image_raw", "sensor_msgs/msg/Image", stamp_ns(k), image))
    return write_bag(folder, form, sent)
