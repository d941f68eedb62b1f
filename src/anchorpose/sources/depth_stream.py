"""The depth images of one camera in a bag: their topic, what their values mean, and which clock stamps them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import TypeVar

from anchorpose.sources.bag_file import BagFile, DamagedBag, Message
from anchorpose.sources.ros_depth import INTEGERS, encoding_of
from anchorpose.sources.ros_messages import CompressedMessage, ImageMessage, read_compressed, read_image
from anchorpose.sources.source import SourceCamera

T = TypeVar("T")

IMAGE = "sensor_msgs/Image"
COMPRESSED = "sensor_msgs/CompressedImage"
READ_BY_HAND = "convert with --intrinsics fx,fy,cx,cy"
"""The remedy where a file has no lens that can be used."""

RECORD_AGAIN = "copy it again from where it was recorded, or record again"
"""The remedy where a file is damaged."""


class Clock(Enum):
    """Where the time of an image stands."""

    STAMP = "in the image's header"
    ORBBEC = "in Orbbec's own field behind the image"
    METADATA = "in a message of RealSense's that follows the image"


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthStream:
    """One camera's images; in_metres: their values are metres, otherwise whole grey values."""

    topic: str
    camera: SourceCamera
    in_metres: bool = False
    clock: Clock = Clock.STAMP
    metadata_topic: str = ""


@dataclass(frozen=True, slots=True)
class Streams:
    """What was found in a bag, and sentences on how it was decided."""

    streams: tuple[DepthStream, ...]
    notes: tuple[str, ...]


def read_any_image(message: Message) -> ImageMessage | CompressedMessage:
    """An image message, plain or compressed. Raises DamagedBag."""
    return read_compressed(message) if message.channel.kind == COMPRESSED else read_image(message)


def first(bag: BagFile, topic: str, read: Callable[[Message], T]) -> T | None:
    """The first message of a topic that can be read, or None."""
    for message in bag.messages((topic,)):
        try:
            return read(message)
        except DamagedBag:
            continue
    return None


def first_grey_image(bag: BagFile, topic: str) -> ImageMessage | CompressedMessage | None:
    """The first image of a topic, or None where its values are not whole numbers of depth."""
    image = first(bag, topic, read_any_image)
    return image if image is not None and encoding_of(image) in INTEGERS else None
