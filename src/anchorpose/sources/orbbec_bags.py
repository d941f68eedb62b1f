"""Orbbec's own recordings: ROS 1 bags with messages of their own (OrbbecSDK_v2, public sources under MIT).

The message definitions that the bag embeds lack fields which its images have, so that ROS's own tools refuse it. Lens
and serial number are written when recording ends. SDK 2.3 orders an image's fields otherwise than 2.4 and later. SDK 1
records with a library without sources: only that its definitions name a type that ROS has not is known (OrbbecSDK issue
195), and that its lens is not to be trusted (pyorbbecsdk issue 176).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.sources.bag_file import Bag, DamagedBag, Message
from anchorpose.sources.ros_messages import (
    READ_BY_HAND,
    DepthStream,
    ImageMessage,
    MessageFields,
    Streams,
    first,
    first_grey_image,
    size_of,
)
from anchorpose.sources.ros_streams import Lens, lens_with, may_be_a_lens
from anchorpose.sources.source import SourceCamera

_DEPTH: Final = "/cam/sensor_3/frameType_3"  # OB_SENSOR_DEPTH, OB_FRAME_DEPTH
_PROFILE: Final = "/cam/streamProfileType_3"  # OB_STREAM_DEPTH
_ABOUT: Final = "/cam/deviceInfo"
_PROPERTY: Final = "/cam/property"
_DISPARITY: Final = "/cam/disparityParam"
_OF_SDK_1: Final = "uint64_t"
_PLAY_IT: Final = (
    "record again with Orbbec Viewer 2, or play it with SDK 1 (ob::Playback), save its depth as 16-bit PNG and convert "
    "their folder"
)
_PRECISION_LEVEL, _DISPARITY_TO_DEPTH, _UNIT_MM = 75, 85, 176  # OBPropertyID
_UNITS_MM: Final = (1.0, 0.8, 0.4, 0.1, 0.2, 0.5, 0.05)  # by OBDepthPrecisionLevel
_BROWN_CONRADY, _RATIONAL, _KANNALA_BRANDT = 3, 4, 5  # OBCameraDistortionModel


@dataclass(frozen=True, slots=True)
class _Unit:
    """Metres per grey value, and whether the file says so."""

    metres: float
    stated: bool


def find_streams(bag: Bag, path: Path) -> Streams | None:
    """Return the depth images of a recording, None where it is not Orbbec's. Raises InputError where it has no
    depth."""
    if any(_OF_SDK_1 in channel.definition for channel in bag.channels):
        raise InputError(path, "it is of Orbbec Viewer or SDK 1, whose format is not published", _PLAY_IT)
    if _DEPTH not in {channel.topic for channel in bag.channels}:
        return None
    image = first_grey_image(bag, _DEPTH, read_depth)
    if image is None:
        raise InputError(path, "its depth images are in a format that is not read", "record depth as Y16 or Z16")
    properties = _properties(bag)
    _refuse_disparity(bag, properties, path)
    unit = _unit(properties)
    lens, about = first(bag, _PROFILE, _read_lens), first(bag, _ABOUT, _read_about)
    width, height = size_of(image)
    camera = SourceCamera(
        name="orbbec",
        width=width,
        height=height,
        depth_scale=unit.metres,
        intrinsics=None if lens is None else lens.intrinsics,
        model=about[0] if about else "",
        serial=about[1] if about else "",
        count=bag.count(_DEPTH),
    )
    stream = DepthStream(topic=_DEPTH, camera=camera, read=read_depth)
    return Streams((stream,), _notes(lens, unit))


def read_depth(message: Message) -> ImageMessage:
    """Return an image with the device's time; SDK 2.3 has the length of metadata before the data, which begin with
    them.

    Raises DamagedBag.
    """
    reader = MessageFields(message)
    _, frame_id = reader.header()
    height, width, encoding = reader.whole("I"), reader.whole("I"), reader.text()
    big_endian, step, length = reader.whole("B") != 0, reader.whole("I"), reader.whole("I")
    if length < 2 * width * height:
        data = reader.take(reader.whole("I"))[length:]
    else:
        data = reader.take(length)
        reader.take(4)  # the depth unit, which is not filled in
    reader.take(8)  # the number of the image
    return ImageMessage(reader.whole("Q") * 1000, frame_id, height, width, encoding, big_endian, step, data, reader)


def _notes(lens: Lens | None, unit: _Unit) -> tuple[str, ...]:
    notes = []
    if not unit.stated:
        notes.append("The file states no depth unit: a millimetre, as Orbbec's own player takes it.")
    if lens is None:
        notes.append(f"The lens of orbbec is missing, because recording was cut off; {READ_BY_HAND}.")
    elif lens.problem:
        notes.append(f"The lens of orbbec is not used: {lens.problem}; {READ_BY_HAND}.")
    return tuple(notes)


def _properties(bag: Bag) -> dict[int, bytes]:
    """Return the device's settings by their number."""
    properties = {}
    for message in bag.messages((_PROPERTY,)):
        try:
            reader = MessageFields(message)
            reader.header()
            number = reader.whole("I")
            properties[number] = bytes(reader.take(reader.whole("I")))
        except DamagedBag:
            continue  # a missing unit or disparity setting is said
    return properties


def _refuse_disparity(bag: Bag, properties: dict[int, bytes], path: Path) -> None:
    """Raise InputError for disparity: stereo cameras record it where the computer, not the camera, turns it into
    depth."""
    stereo = any(channel.topic == _DISPARITY for channel in bag.channels)
    if stereo and not any(properties.get(_DISPARITY_TO_DEPTH, b"")):
        raise InputError(
            path,
            "it holds disparity and not depth",
            "record again with the hardware's disparity-to-depth switched on (in Orbbec Viewer: HW D2D)",
        )


def _unit(properties: dict[int, bytes]) -> _Unit:
    if len(properties.get(_UNIT_MM, b"")) == 4:
        (unit_mm,) = struct.unpack("<f", properties[_UNIT_MM])
        if 0.0 < unit_mm <= 10.0:
            return _Unit(float(f"{unit_mm / 1000.0:.6g}"), True)
    level = int.from_bytes(properties.get(_PRECISION_LEVEL, b"\xff"), "little")
    if level < len(_UNITS_MM):
        return _Unit(float(f"{_UNITS_MM[level] / 1000.0:.6g}"), True)
    return _Unit(0.001, False)


def _read_lens(message: Message) -> Lens:
    """Return ``custom_msg/OBStreamProfileInfo``; its coefficients are k1 to k6, then p1, p2."""
    reader = MessageFields(message)
    reader.header()
    reader.take(2 + 4 * (9 + 3) + 2 * 3)  # stream and format, pose to colour, width, height and rate
    fx, fy, cx, cy = reader.numbers("f", 4).tolist()
    k1, k2, k3, k4, k5, k6, p1, p2 = reader.numbers("f", 8).tolist()
    model = reader.whole("B")
    if not may_be_a_lens((fx, fy, cx, cy), (k1, k2, k3, k4, k5, k6, p1, p2)):
        return Lens(None, "the camera was not calibrated")
    if model in (_BROWN_CONRADY, _RATIONAL):
        D = (k1, k2, p1, p2, k3, k4, k5, k6) if any((k4, k5, k6)) else (k1, k2, p1, p2, k3)
        return lens_with((fx, fy, cx, cy), D, "rational_polynomial" if len(D) == 8 else "plumb_bob")
    if model == _KANNALA_BRANDT:
        return lens_with((fx, fy, cx, cy), (k1, k2, k3, k4), "equidistant")
    return lens_with((fx, fy, cx, cy), (k1, k2, p1, p2, k3, k4, k5, k6), f"Orbbec's number {model}")


def _read_about(message: Message) -> tuple[str, str]:
    """Return ``custom_msg/OBDeviceInfo``: name and serial number."""
    reader = MessageFields(message)
    reader.header()
    name, _, _ = reader.text(), reader.text(), reader.text()
    reader.take(4)  # USB's numbers
    reader.text()  # the port that it was plugged into
    return name, reader.text()
