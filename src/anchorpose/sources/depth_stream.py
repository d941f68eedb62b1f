"""The depth images of one camera in a bag: their topic, what their values mean, and where their times stand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from anchorpose.sources.bag_file import BagFile, DamagedBag, Message
from anchorpose.sources.ros_depth import INTEGERS, encoding_of
from anchorpose.sources.ros_messages import CompressedMessage, ImageMessage, read_compressed, read_image
from anchorpose.sources.source import SourceCamera

T = TypeVar("T")
Image = ImageMessage | CompressedMessage

IMAGE = "sensor_msgs/Image"
COMPRESSED = "sensor_msgs/CompressedImage"
READ_BY_HAND = "convert with --intrinsics fx,fy,cx,cy"
"""The remedy where a file has no lens that can be used."""

RECORD_AGAIN = "copy it again from where it was recorded, or record again"
"""The remedy where a file is damaged."""


def read_any_image(message: Message) -> Image:
    """An image message, plain or compressed. Raises DamagedBag."""
    return read_compressed(message) if message.channel.kind == COMPRESSED else read_image(message)


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthStream:
    """One camera's images.

    in_metres: their values are metres, otherwise whole grey values; read: the image of a message, with the device's
    time; metadata_topic: where that time comes in a message that follows the image, and not in the image.
    """

    topic: str
    camera: SourceCamera
    in_metres: bool = False
    read: Callable[[Message], Image] = read_any_image
    metadata_topic: str = ""


@dataclass(frozen=True, slots=True)
class Streams:
    """What was found in a bag, and sentences on how it was decided."""

    streams: tuple[DepthStream, ...]
    notes: tuple[str, ...]


def first(bag: BagFile, topic: str, read: Callable[[Message], T]) -> T | None:
    """The first message of a topic that can be read, or None."""
    for message in bag.messages((topic,)):
        try:
            return read(message)
        except DamagedBag:
            continue
    return None


def first_grey_image(bag: BagFile, topic: str, read: Callable[[Message], Image] = read_any_image) -> Image | None:
    """The first image of a topic, or None where its values are not whole numbers of depth."""
    image = first(bag, topic, read)
    return image if image is not None and encoding_of(image) in INTEGERS else None
