"""RealSense's own recordings: ROS 1 bags of librealsense, and ROS 2 databases since version 2.58.

The layout is that of librealsense's public sources (ros_file_format.h, ros_writer.cpp) and of files that its recorder
wrote. Depth is in the camera's own unit. In databases the image's header has the recorder's clock; the device's time
is in a text message that follows the image.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.sources.bag_file import Bag, DamagedBag, Message
from anchorpose.sources.ros_messages import (
    READ_BY_HAND,
    CompressedMessage,
    DepthStream,
    ImageMessage,
    MessageFields,
    Streams,
    first,
    first_grey_image,
    read_camera_info,
    size_of,
)
from anchorpose.sources.ros_streams import Lens, lens_with, may_be_a_lens
from anchorpose.sources.source import SourceCamera

_DEPTH: Final = re.compile(r"(?P<sensor>(?P<device>/device_\d+)/sensor_\d+)/Depth_\d+/image/data(/compressedDepth)?")
_MODELS: Final = {"Brown Conrady": "plumb_bob", "Kannala Brandt4": "equidistant"}
_OWN_FIELDS: Final = "1"  # in place of the frame's name: the image is followed by its depth unit

Image = ImageMessage | CompressedMessage


def find_streams(bag: Bag, path: Path) -> Streams | None:
    """Return the depth images of a recording, None where it is not RealSense's. Raises InputError where no unit is
    known."""
    topics = sorted(channel.topic for channel in bag.channels)
    matches = [match for topic in topics if (match := _DEPTH.fullmatch(topic))]
    if not matches:
        return None
    streams, notes = [], []
    for number, match in enumerate(matches):
        image = first_grey_image(bag, match[0])
        if image is None:
            notes.append(f"{match[0]} has no depth image that can be read: left out.")
            continue
        stream, lens = _stream(bag, match, image, path, number if len(matches) > 1 else None)
        if lens.problem:
            notes.append(f"The lens of {stream.camera.name} is not used: {lens.problem}; {READ_BY_HAND}.")
        streams.append(stream)
    return Streams(tuple(streams), tuple(notes))


def device_time_ns(message: Message) -> int | None:
    """Return the time that a metadata message of a database gives, None where it has none. Raises DamagedBag."""
    milliseconds = _number(_texts(message).get("timestamp", ""))
    return None if milliseconds is None else round(milliseconds * 1_000_000)


def _stream(bag: Bag, match: re.Match[str], image: Image, path: Path, number: int | None) -> tuple[DepthStream, Lens]:
    topic = match[0]
    prefix = topic.partition("/image/data")[0]
    scale = _depth_unit(bag, match["sensor"], image)
    if scale is None:
        raise InputError(path, f"the depth unit of {topic} is missing", "record again with a current RealSense Viewer")
    lens, about = _lens(bag, prefix), _about(bag, match["device"])
    width, height = size_of(image)
    metadata = f"{prefix}/image/metadata"
    in_metadata = any(c.topic == metadata and c.cdr for c in bag.channels)
    camera = SourceCamera(
        name="realsense" if number is None else f"realsense_{number}",
        width=width,
        height=height,
        depth_scale=scale,
        intrinsics=lens.intrinsics,
        model=about.get("Name", ""),
        serial=about.get("Serial Number", ""),
        count=bag.count(topic),
    )
    return DepthStream(topic=topic, camera=camera, metadata_topic=metadata if in_metadata else ""), lens


def _depth_unit(bag: Bag, sensor: str, image: Image) -> float | None:
    """Return metres per grey value, of the image itself or of the sensor's option."""
    if isinstance(image, ImageMessage) and image.frame_id == _OWN_FIELDS:
        unit = float(image.reader.number("f"))
    else:
        unit = first(bag, f"{sensor}/option/Depth_Units/value", _option) or 0.0
    # single precision makes 0.0002500000118 of 0.00025; every unit has fewer than six digits
    return float(f"{unit:.6g}") if math.isfinite(unit) and 0.0 < unit < 1.0 else None


def _option(message: Message) -> float:
    reader = MessageFields(message)
    if message.channel.cdr:
        return _number(reader.text()) or 0.0
    return float(reader.number("f"))


def _lens(bag: Bag, prefix: str) -> Lens:
    info = first(bag, f"{prefix}/info/camera_info", read_camera_info)
    if info is not None:
        return _lens_with(info.K[0], info.K[4], info.K[2], info.K[5], info.D, info.model)
    texts = first(bag, f"{prefix}/camera_info", _texts) or {}
    written = [*(texts.get(name, "") for name in ("fx", "fy", "ppx", "ppy")), *texts.get("coeffs", "").split(",")]
    values = [value for text in written if (value := _number(text)) is not None]
    if len(values) != len(written):
        return Lens(None, "it is missing in the file")
    fx, fy, cx, cy, *D = values
    return _lens_with(fx, fy, cx, cy, tuple(D), texts.get("model", ""))


def _lens_with(fx: float, fy: float, cx: float, cy: float, D: tuple[float, ...], model: str) -> Lens:
    if not may_be_a_lens((fx, fy, cx, cy), D):
        return Lens(None, "the camera was not calibrated")
    if _MODELS.get(model) == "equidistant":
        D = D[:4]  # of the five places that every model has
    return lens_with((fx, fy, cx, cy), D, _MODELS.get(model, model))


def _about(bag: Bag, device: str) -> dict[str, str]:
    """Return name and serial number, among others: one message for each in a bag, one for all in a database."""
    about: dict[str, str] = {}
    for message in bag.messages((f"{device}/info",)):
        try:
            about |= _texts(message)
        except DamagedBag:
            continue  # a name or number that is missing stays empty
    return about


def _texts(message: Message) -> dict[str, str]:
    """Return names and values of a message: ``diagnostic_msgs/KeyValue``, or ``name=value;...`` in a text."""
    reader = MessageFields(message)
    if not message.channel.cdr:
        return {reader.text(): reader.text()}
    pairs = (pair.partition("=") for pair in reader.text().split(";"))
    return {name: value for name, _, value in pairs}


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
