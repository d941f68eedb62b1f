"""Decode the ROS messages that a depth recording needs: ROS 1's serialization and ROS 2's CDR.

Fields are read according to the published definitions (docs.ros.org, sensor_msgs and tf2_msgs). The definitions that a
bag embeds are not used, since in bags of Orbbec and RealSense they lack fields that the messages have.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np

from anchorpose.recording.depth_image import image_chunks
from anchorpose.sources.bag_file import Bag, DamagedBag, Message
from anchorpose.sources.source import NO_READING, SourceCamera

INTEGERS: Final = frozenset({"16UC1", "mono16", "Z16", "z16"})  # encodings of depth as 16-bit whole numbers
METRES: Final = "32FC1"  # encoding of depth as floats in metres
_PNG: Final = b"\x89PNG"
_HEADER: Final = 12  # bytes, size of the header that compressed_depth_image_transport adds: format and two parameters
T = TypeVar("T")
IMAGE = "sensor_msgs/Image"
COMPRESSED = "sensor_msgs/CompressedImage"
READ_BY_HAND = "convert with --intrinsics fx,fy,cx,cy"
"""Remedy that notes state if a file has no usable lens."""

RECORD_AGAIN = "copy it again from where it was recorded, or record again"
"""Remedy that error messages state if a file is damaged."""


class MessageFields:
    """A reader of one message's fields, in their order. A read beyond the message's end raises DamagedBag."""

    def __init__(self, message: Message) -> None:
        self._data = memoryview(message.data)
        self._cdr = message.channel.cdr
        self._order = "<"
        self._start = self._place = 0
        if self._cdr:
            if len(self._data) < 4 or self._data[0] != 0 or self._data[1] > 1:
                raise DamagedBag("a message is not in the encoding that ROS 2 uses")
            self._order = "<" if self._data[1] else ">"
            self._start = self._place = 4

    def number(self, kind: str) -> int | float:
        """Return the next value; kind: its type as a letter of Python's ``struct``."""
        size = struct.calcsize("<" + kind)
        self._align(size)
        return struct.unpack(self._order + kind, self.take(size))[0]

    def whole(self, kind: str) -> int:
        """Return the next whole number."""
        return int(self.number(kind))

    def numbers(self, kind: str, count: int) -> np.ndarray:
        """Return the next numbers (count,) float64."""
        size = struct.calcsize("<" + kind)
        if count:
            self._align(size)
        return np.frombuffer(self.take(size * count), self._order + kind).astype(np.float64)

    def text(self) -> str:
        """Return the next text."""
        raw = bytes(self.take(self.whole("I")))
        return raw.removesuffix(b"\0").decode("utf-8", "replace") if self._cdr else raw.decode("utf-8", "replace")

    def take(self, size: int) -> memoryview:
        """Return the next ``size`` bytes unchanged."""
        if size > len(self._data) - self._place:
            raise DamagedBag("a message ends before its last field")
        self._place += size
        return self._data[self._place - size : self._place]

    def header(self) -> tuple[int, str]:
        """Return the next ``std_msgs/Header``: the time stamp in nanoseconds, and the name of the coordinate frame."""
        if not self._cdr:
            self.take(4)  # skip ROS 1's sequence number
        stamp_ns = self.whole("I") * 1_000_000_000 + self.whole("I")
        return stamp_ns, self.text()

    def _align(self, size: int) -> None:
        """Skip to the next position divisible by ``size``, since CDR aligns each number to its size in bytes."""
        if self._cdr:
            self._place += -(self._place - self._start) % size


@dataclass(frozen=True, slots=True, eq=False)
class ImageMessage:
    """A ``sensor_msgs/Image``. step: bytes per row; reader: the reader of the same message, positioned after the image,
    where vendors add their own fields.
    """

    stamp_ns: int
    frame_id: str
    height: int
    width: int
    encoding: str
    big_endian: bool
    step: int
    data: memoryview
    reader: MessageFields


@dataclass(frozen=True, slots=True, eq=False)
class CompressedMessage:
    """A ``sensor_msgs/CompressedImage``."""

    stamp_ns: int
    frame_id: str
    format: str
    data: memoryview


@dataclass(frozen=True, slots=True, eq=False)
class CameraInfo:
    """A ``sensor_msgs/CameraInfo``. model, D: distortion model and coefficients; K, P: camera matrix and projection,
    row by row; binning: number of pixels binned across and down; roi: column, row, height, width of the images' region
    in the full image, all 0 if the region is the full image.
    """

    frame_id: str
    height: int
    width: int
    model: str
    D: tuple[float, ...]
    K: tuple[float, ...]
    P: tuple[float, ...]
    binning: tuple[int, int]
    roi: tuple[int, int, int, int]


Image = ImageMessage | CompressedMessage


def read_image(message: Message) -> ImageMessage:
    """Read an image message. Raises DamagedBag if the message is cut off."""
    reader = MessageFields(message)
    stamp_ns, frame_id = reader.header()
    height, width, encoding = reader.whole("I"), reader.whole("I"), reader.text()
    big_endian, step = reader.whole("B") != 0, reader.whole("I")
    return ImageMessage(
        stamp_ns, frame_id, height, width, encoding, big_endian, step, reader.take(reader.whole("I")), reader
    )


def read_compressed(message: Message) -> CompressedMessage:
    """Read a compressed image message. Raises DamagedBag if the message is cut off."""
    reader = MessageFields(message)
    stamp_ns, frame_id = reader.header()
    return CompressedMessage(stamp_ns, frame_id, reader.text(), reader.take(reader.whole("I")))


def read_camera_info(message: Message) -> CameraInfo:
    """Read a camera info message. Raises DamagedBag if the message is cut off."""
    reader = MessageFields(message)
    _, frame_id = reader.header()
    height, width, model = reader.whole("I"), reader.whole("I"), reader.text()
    D = tuple(reader.numbers("d", min(reader.whole("I"), 100)).tolist())
    K = tuple(reader.numbers("d", 9).tolist())
    reader.numbers("d", 9)  # skip R, the rotation that rectifies stereo pairs
    P = tuple(reader.numbers("d", 12).tolist())
    binning = reader.whole("I"), reader.whole("I")
    column, row, roi_height, roi_width = (reader.whole("I") for _ in range(4))
    return CameraInfo(frame_id, height, width, model, D, K, P, binning, (column, row, roi_height, roi_width))


def read_transforms(message: Message) -> list[tuple[str, str, np.ndarray]]:
    """Read ``tf2_msgs/TFMessage``: for each transform the names of parent and child frame, and (7,) translation in
    metres and quaternion x, y, z, w. Raises DamagedBag if the message is cut off.
    """
    reader = MessageFields(message)
    transforms = []
    for _ in range(reader.whole("I")):
        _, parent = reader.header()
        transforms.append((parent.lstrip("/"), reader.text().lstrip("/"), reader.numbers("d", 7)))
    return transforms


def encoding_of(image: Image) -> str:
    """Return the encoding of an image, one of ``INTEGERS`` or ``METRES``; empty if it is not a lossless depth image."""
    if isinstance(image, ImageMessage):
        return image.encoding if image.encoding in INTEGERS | {METRES} else ""
    encoding, _, packing = image.format.partition(";")
    lossless = ("compressedDepth" in packing and "rvl" not in packing) or "png" in packing
    return encoding.strip() if lossless and encoding.strip() in INTEGERS | {METRES} else ""


def size_of(image: Image) -> tuple[int, int]:
    """Return width and height of an image in pixels. Raises DamagedBag if the image is not complete."""
    if isinstance(image, ImageMessage):
        return image.width, image.height
    png = _png_of(image)
    if len(png) < 24:
        raise DamagedBag("a compressed image is not complete")
    width, height = struct.unpack(">II", png[16:24])
    return int(width), int(height)


def grey_of(image: Image) -> np.ndarray:
    """Return the grey values (height, width) uint16 of an image, 0 = no reading. Raises DamagedBag if the image is
    damaged.
    """
    grey = _plain(image, 2) if isinstance(image, ImageMessage) else _decode(_png_of(image))
    grey = grey.astype(np.uint16)
    grey[grey == NO_READING] = 0
    return grey


def metres_of(image: Image) -> np.ndarray:
    """Return the metres (height, width) float32 of an image, NaN = no reading. Raises DamagedBag if the image is
    damaged.
    """
    if isinstance(image, ImageMessage):
        metres = _plain(image, 4).astype(np.float32)
    else:
        # compressed_depth_image_transport stores inverse depth: grey value of the PNG = a / depth + b
        a, b = struct.unpack("<ff", bytes(image.data[4:_HEADER]).ljust(8, b"\0"))
        packed = _decode(_png_of(image)).astype(np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            metres = np.where(packed > 0, np.float32(a) / (packed - np.float32(b)), np.float32(np.nan))
    metres[~(np.isfinite(metres) & (metres > 0.0))] = np.nan
    return metres


def _plain(image: ImageMessage, size: int) -> np.ndarray:
    """Return the values (height, width) of an uncompressed image, ``size`` bytes each; its rows may be padded."""
    row = image.width * size
    step = image.step or row
    if not 0 < row <= step or image.height == 0 or step * image.height > len(image.data):
        raise DamagedBag("an image has fewer bytes than its size needs")
    order = ">" if image.big_endian else "<"
    rows = np.frombuffer(image.data, np.uint8, step * image.height).reshape(image.height, step)
    return np.ascontiguousarray(rows[:, :row]).view(f"{order}{'u' if size == 2 else 'f'}{size}")


def _png_of(image: CompressedMessage) -> bytes:
    data = bytes(image.data)
    png = data if data.startswith(_PNG) else data[_HEADER:]
    if not png.startswith(_PNG):
        raise DamagedBag("a compressed image is not a PNG")
    return png


def _decode(png: bytes) -> np.ndarray:
    import cv2

    image, problem = image_chunks(png)
    grey = None if problem else cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_UNCHANGED)
    if grey is None or grey.dtype != np.uint16 or grey.ndim != 2:
        raise DamagedBag("a compressed image is not complete")
    return np.asarray(grey)


def read_any_image(message: Message) -> Image:
    """Read an image message, compressed or not. Raises DamagedBag if the message is cut off."""
    return read_compressed(message) if message.channel.kind == COMPRESSED else read_image(message)


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthStream:
    """The stream of one camera's images.

    in_metres: True if the values are metres, False if they are whole grey values; read: function that reads an image
    with its time stamp from a message; metadata_topic: topic of the messages that follow the images and have the
    device's time, empty without such messages.
    """

    topic: str
    camera: SourceCamera
    in_metres: bool = False
    read: Callable[[Message], Image] = read_any_image
    metadata_topic: str = ""


@dataclass(frozen=True, slots=True)
class Streams:
    """The depth streams found in a bag, and notes (sentences) on how they were chosen."""

    streams: tuple[DepthStream, ...]
    notes: tuple[str, ...]


def readable(bag: Bag, topic: str, read: Callable[[Message], T]) -> Iterator[T]:
    """Yield the content of each message of a topic; damaged messages are left out."""
    for message in bag.messages((topic,)):
        try:
            content = read(message)
        except DamagedBag:
            continue
        yield content


def first(bag: Bag, topic: str, read: Callable[[Message], T]) -> T | None:
    """Return the content of the first message of a topic that can be read, or None without such a message."""
    return next(readable(bag, topic, read), None)


def first_grey_image(bag: Bag, topic: str, read: Callable[[Message], Image] = read_any_image) -> Image | None:
    """Return the first image of a topic; None if the topic has no image, or if the values are not depth in whole
    numbers.
    """
    image = first(bag, topic, read)
    return image if image is not None and encoding_of(image) in INTEGERS else None
