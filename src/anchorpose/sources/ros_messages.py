"""The ROS messages that a depth recording needs, from their bytes: ROS 1's serialization and ROS 2's CDR.

Only what is fixed in the published definitions is read (docs.ros.org, sensor_msgs and tf2_msgs), not the definitions
that a bag embeds: those of Orbbec and RealSense lack fields that their own messages have.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from anchorpose.sources.bag_file import DamagedBag, Message, Wire


class Reader:
    """Reads the fields of one message in their order; raises DamagedBag beyond its end."""

    def __init__(self, message: Message) -> None:
        self._data = memoryview(message.data)
        self._cdr = message.channel.wire is Wire.CDR
        self._order = "<"
        self._start = self._place = 0
        if self._cdr:
            if len(self._data) < 4 or self._data[0] != 0 or self._data[1] > 1:
                raise DamagedBag("a message is not in the encoding that ROS 2 uses")
            self._order = "<" if self._data[1] else ">"
            self._start = self._place = 4

    def number(self, kind: str) -> int | float:
        """The next value; kind: a letter of ``struct``."""
        size = struct.calcsize("<" + kind)
        self._align(size)
        return struct.unpack(self._order + kind, self.take(size))[0]

    def whole(self, kind: str) -> int:
        """The next whole number."""
        return int(self.number(kind))

    def numbers(self, kind: str, count: int) -> np.ndarray:
        """(count,) float64."""
        size = struct.calcsize("<" + kind)
        if count:
            self._align(size)
        return np.frombuffer(self.take(size * count), self._order + kind).astype(np.float64)

    def text(self) -> str:
        """The next text."""
        raw = bytes(self.take(self.whole("I")))
        return raw.removesuffix(b"\0").decode("utf-8", "replace") if self._cdr else raw.decode("utf-8", "replace")

    def take(self, size: int) -> memoryview:
        """The next bytes as they are."""
        if size > len(self._data) - self._place:
            raise DamagedBag("a message is shorter than what it holds")
        self._place += size
        return self._data[self._place - size : self._place]

    def header(self) -> tuple[int, str]:
        """``std_msgs/Header``: the stamp in nanoseconds, and the frame."""
        if not self._cdr:
            self.take(4)  # ROS 1's sequence number
        stamp_ns = self.whole("I") * 1_000_000_000 + self.whole("I")
        return stamp_ns, self.text()

    def _align(self, size: int) -> None:
        """CDR begins each number at a multiple of its size."""
        if self._cdr:
            self._place += -(self._place - self._start) % size


@dataclass(frozen=True, slots=True, eq=False)
class ImageMessage:
    """``sensor_msgs/Image``; reader: what follows, which only vendors' own messages have."""

    stamp_ns: int
    frame_id: str
    height: int
    width: int
    encoding: str
    big_endian: bool
    step: int
    data: memoryview
    reader: Reader


@dataclass(frozen=True, slots=True, eq=False)
class CompressedMessage:
    """``sensor_msgs/CompressedImage``."""

    stamp_ns: int
    frame_id: str
    format: str
    data: memoryview


@dataclass(frozen=True, slots=True, eq=False)
class CameraInfo:
    """``sensor_msgs/CameraInfo``; roi: column, row, height, width in the full image, zeros for all of it."""

    frame_id: str
    height: int
    width: int
    model: str
    D: tuple[float, ...]
    K: tuple[float, ...]
    P: tuple[float, ...]
    binning: tuple[int, int]
    roi: tuple[int, int, int, int]


def read_image(message: Message) -> ImageMessage:
    """Raises DamagedBag."""
    reader = Reader(message)
    stamp_ns, frame_id = reader.header()
    height, width, encoding = reader.whole("I"), reader.whole("I"), reader.text()
    big_endian, step = reader.whole("B") != 0, reader.whole("I")
    return ImageMessage(
        stamp_ns, frame_id, height, width, encoding, big_endian, step, reader.take(reader.whole("I")), reader
    )


def read_compressed(message: Message) -> CompressedMessage:
    """Raises DamagedBag."""
    reader = Reader(message)
    stamp_ns, frame_id = reader.header()
    return CompressedMessage(stamp_ns, frame_id, reader.text(), reader.take(reader.whole("I")))


def read_camera_info(message: Message) -> CameraInfo:
    """Raises DamagedBag."""
    reader = Reader(message)
    _, frame_id = reader.header()
    height, width, model = reader.whole("I"), reader.whole("I"), reader.text()
    D = tuple(reader.numbers("d", min(reader.whole("I"), 100)).tolist())
    K = tuple(reader.numbers("d", 9).tolist())
    reader.numbers("d", 9)  # R, which turns stereo pairs
    P = tuple(reader.numbers("d", 12).tolist())
    binning = reader.whole("I"), reader.whole("I")
    column, row, roi_height, roi_width = (reader.whole("I") for _ in range(4))
    return CameraInfo(frame_id, height, width, model, D, K, P, binning, (column, row, roi_height, roi_width))


def read_transforms(message: Message) -> list[tuple[str, str, np.ndarray]]:
    """``tf2_msgs/TFMessage``: parent and child frame, and (7,) translation in metres and quaternion x, y, z, w.

    Raises DamagedBag.
    """
    reader = Reader(message)
    transforms = []
    for _ in range(reader.whole("I")):
        _, parent = reader.header()
        transforms.append((parent.lstrip("/"), reader.text().lstrip("/"), reader.numbers("d", 7)))
    return transforms
