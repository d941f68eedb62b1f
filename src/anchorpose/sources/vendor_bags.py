"""Read recordings of RealSense's and Orbbec's software: bags with message types that only these vendors use.

RealSense writes ROS 1 bags, and ROS 2 databases since version 2.58 of librealsense. Their layout is known from
librealsense's public sources (ros_file_format.h, ros_writer.cpp) and from files that its recorder wrote. The unit of
depth is an option of the camera. In databases, the header of an image has the time of the recorder's clock; the
device's time is in a text message that follows the image.

Orbbec writes ROS 1 bags (OrbbecSDK_v2, public sources under MIT). The message definitions that the bag embeds lack
fields of the image messages, so ROS's tools refuse the bag. Lens and serial number are written when recording ends. SDK
2.3 writes the fields of an image in another order than SDK 2.4 and later versions. SDK 1 records with a library without
public sources. About its files, only two facts are known: the message definitions use a type that ROS does not have
(OrbbecSDK issue 195), and the lens is unreliable (pyorbbecsdk issue 176).
"""

from __future__ import annotations

import math
import re
import struct
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.sources.bag_file import Bag, Message
from anchorpose.sources.ros_messages import (
    READ_BY_HAND,
    DepthStream,
    Image,
    ImageMessage,
    MessageFields,
    Streams,
    first,
    first_grey_image,
    read_camera_info,
    readable,
    size_of,
)
from anchorpose.sources.ros_streams import Lens, lens_with
from anchorpose.sources.source import MILLIMETRE_M, SourceCamera

_DEPTH: Final = re.compile(r"(?P<sensor>(?P<device>/device_\d+)/sensor_\d+)/Depth_\d+/image/data(/compressedDepth)?")
_MODELS: Final = {"Brown Conrady": "plumb_bob", "Kannala Brandt4": "equidistant"}
_OWN_FIELDS: Final = "1"  # frame_id that marks images whose depth unit follows the image in the message


def find_realsense(bag: Bag, path: Path) -> Streams | None:
    """Find the depth images in a bag; None if the bag was not recorded by RealSense's software. Raises InputError if
    the unit of depth is unknown.
    """
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
    """Return the device's time in a metadata message of RealSense, None if not stated. Raises DamagedBag if the message
    is damaged.
    """
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
    """Return the metres per grey value, as the image itself or an option of the sensor states them; None if unknown."""
    if isinstance(image, ImageMessage) and image.frame_id == _OWN_FIELDS:
        unit = float(image.reader.number("f"))
    else:
        unit = first(bag, f"{sensor}/option/Depth_Units/value", _option) or 0.0
    # rounded, since single precision turns 0.00025 into 0.0002500000118; units have fewer than six digits
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
    if _MODELS.get(model) == "equidistant":
        D = D[:4]  # this model has four coefficients, but the file always has five
    return lens_with((fx, fy, cx, cy), D, _MODELS.get(model, model))


def _about(bag: Bag, device: str) -> dict[str, str]:
    """Return the device's name, serial number and other information, by the vendor's name for each item. A ROS 1 bag
    has one message per item, a database has one message for all items.
    """
    # the device's name or serial number stays empty if its message is damaged
    return {name: value for texts in readable(bag, f"{device}/info", _texts) for name, value in texts.items()}


def _texts(message: Message) -> dict[str, str]:
    """Return the values of a message by their names. In a ROS 1 bag, the message is a ``diagnostic_msgs/KeyValue``; in
    a database, it is a text ``name=value;...``.
    """
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


_ORBBEC_DEPTH: Final = "/cam/sensor_3/frameType_3"  # each 3 is an SDK number: OB_SENSOR_DEPTH, OB_FRAME_DEPTH
_PROFILE: Final = "/cam/streamProfileType_3"  # 3 is the SDK's number OB_STREAM_DEPTH
_ABOUT: Final = "/cam/deviceInfo"
_PROPERTY: Final = "/cam/property"
_DISPARITY: Final = "/cam/disparityParam"
_OF_SDK_1: Final = "uint64_t"
_PLAY_IT: Final = (
    "record again with Orbbec Viewer 2, or play it with SDK 1 (ob::Playback), save its depth as 16-bit PNG and convert "
    "their folder"
)
_PRECISION_LEVEL, _DISPARITY_TO_ORBBEC_DEPTH, _UNIT_MM = 75, 85, 176  # numbers of settings (Orbbec's OBPropertyID)
_UNITS_MM: Final = (1.0, 0.8, 0.4, 0.1, 0.2, 0.5, 0.05)  # mm per grey value for each OBDepthPrecisionLevel, from 0 on
_BROWN_CONRADY, _RATIONAL, _KANNALA_BRANDT = 3, 4, 5  # lens models (Orbbec's OBCameraDistortionModel)


def find_orbbec(bag: Bag, path: Path) -> Streams | None:
    """Find the depth images in a bag; None if the bag was not recorded by Orbbec's software. Raises InputError if the
    depth cannot be read.
    """
    if any(_OF_SDK_1 in channel.definition for channel in bag.channels):
        raise InputError(path, "it is of Orbbec Viewer or SDK 1, whose format is not published", _PLAY_IT)
    if _ORBBEC_DEPTH not in {channel.topic for channel in bag.channels}:
        return None
    image = first_grey_image(bag, _ORBBEC_DEPTH, read_depth)
    if image is None:
        raise InputError(path, "its depth images are in a format that cannot be read", "record depth as Y16 or Z16")
    properties = _properties(bag)
    _refuse_disparity(bag, properties, path)
    unit_m = _unit_m(properties)
    lens, about = first(bag, _PROFILE, _read_lens), first(bag, _ABOUT, _read_about)
    width, height = size_of(image)
    camera = SourceCamera(
        name="orbbec",
        width=width,
        height=height,
        depth_scale=unit_m or MILLIMETRE_M,
        intrinsics=None if lens is None else lens.intrinsics,
        model=about[0] if about else "",
        serial=about[1] if about else "",
        count=bag.count(_ORBBEC_DEPTH),
    )
    stream = DepthStream(topic=_ORBBEC_DEPTH, camera=camera, read=read_depth)
    return Streams((stream,), _notes(lens, unit_m))


def read_depth(message: Message) -> ImageMessage:
    """Read an image of Orbbec with the device's time. SDK 2.3 writes the length of the metadata before the image's
    data, which then begin with the metadata.

    Raises DamagedBag if the message is cut off.
    """
    reader = MessageFields(message)
    _, frame_id = reader.header()
    height, width, encoding = reader.whole("I"), reader.whole("I"), reader.text()
    big_endian, step, length = reader.whole("B") != 0, reader.whole("I"), reader.whole("I")
    if length < 2 * width * height:
        data = reader.take(reader.whole("I"))[length:]
    else:
        data = reader.take(length)
        reader.take(4)  # skip the field of the depth unit, which Orbbec leaves empty
    reader.take(8)  # skip the number of the image
    return ImageMessage(reader.whole("Q") * 1000, frame_id, height, width, encoding, big_endian, step, data, reader)


def _notes(lens: Lens | None, unit_m: float | None) -> tuple[str, ...]:
    notes = []
    if unit_m is None:
        notes.append("The file states no depth unit: a millimetre is assumed, as in Orbbec's player.")
    if lens is None:
        notes.append(f"The lens of orbbec is missing, because recording was cut off; {READ_BY_HAND}.")
    elif lens.problem:
        notes.append(f"The lens of orbbec is not used: {lens.problem}; {READ_BY_HAND}.")
    return tuple(notes)


def _properties(bag: Bag) -> dict[int, bytes]:
    """Return the bytes of each of the device's settings, by the number of the setting (Orbbec's OBPropertyID)."""

    def read(message: Message) -> tuple[int, bytes]:
        reader = MessageFields(message)
        reader.header()
        return reader.whole("I"), bytes(reader.take(reader.whole("I")))

    # damaged messages are left out: ``_notes`` then reports a missing unit, and ``_refuse_disparity`` refuses images of
    # a stereo camera whose disparity setting is missing
    return dict(readable(bag, _PROPERTY, read))


def _refuse_disparity(bag: Bag, properties: dict[int, bytes], path: Path) -> None:
    """Raise InputError if the images are disparity, not depth. Stereo cameras record disparity if the computer, not the
    camera, converts disparity to depth.
    """
    stereo = any(channel.topic == _DISPARITY for channel in bag.channels)
    if stereo and not any(properties.get(_DISPARITY_TO_ORBBEC_DEPTH, b"")):
        raise InputError(
            path,
            "it holds disparity and not depth",
            "record again with the hardware's disparity-to-depth switched on (in Orbbec Viewer: HW D2D)",
        )


def _unit_m(properties: dict[int, bytes]) -> float | None:
    """Return the metres per grey value by the device's settings, None if the file does not state them."""
    level, unit_mm = int.from_bytes(properties.get(_PRECISION_LEVEL, b"\xff"), "little"), 0.0
    if len(properties.get(_UNIT_MM, b"")) == 4:
        (unit_mm,) = struct.unpack("<f", properties[_UNIT_MM])
    if not 0.0 < unit_mm <= 10.0:
        unit_mm = _UNITS_MM[level] if level < len(_UNITS_MM) else 0.0
    return float(f"{unit_mm / 1000.0:.6g}") if unit_mm else None


def _read_lens(message: Message) -> Lens:
    """Read the lens from a message of the type ``custom_msg/OBStreamProfileInfo``, which lists the distortion
    coefficients k1 to k6, then p1 and p2.
    """
    reader = MessageFields(message)
    reader.header()
    reader.take(2 + 4 * (9 + 3) + 2 * 3)  # skip stream, format, pose relative to colour camera, width, height, rate
    fx, fy, cx, cy = reader.numbers("f", 4).tolist()
    k1, k2, k3, k4, k5, k6, p1, p2 = reader.numbers("f", 8).tolist()
    model = reader.whole("B")
    if model in (_BROWN_CONRADY, _RATIONAL):
        D = (k1, k2, p1, p2, k3, k4, k5, k6) if any((k4, k5, k6)) else (k1, k2, p1, p2, k3)
        return lens_with((fx, fy, cx, cy), D, "rational_polynomial" if len(D) == 8 else "plumb_bob")
    if model == _KANNALA_BRANDT:
        return lens_with((fx, fy, cx, cy), (k1, k2, k3, k4), "equidistant")
    return lens_with((fx, fy, cx, cy), (k1, k2, p1, p2, k3, k4, k5, k6), f"Orbbec's number {model}")


def _read_about(message: Message) -> tuple[str, str]:
    """Read ``custom_msg/OBDeviceInfo``: name and serial number."""
    reader = MessageFields(message)
    reader.header()
    name, _, _ = reader.text(), reader.text(), reader.text()
    reader.take(4)  # skip the USB numbers
    reader.text()  # skip the USB port
    return name, reader.text()
