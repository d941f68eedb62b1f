"""Matroska files in the layout of the published Azure Kinect Sensor SDK (``src/record``), written element by element.

PyAV's own writer knows no time stamps finer than a millisecond; the recorder's are microseconds.
"""

import json
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

PARAMETERS = (0.502, 0.495, 0.4901, 0.4912, 0.6, -0.03, -0.003, 0.93, 0.1, -0.015, 0.0, 0.0, -6e-05, 3e-05)
"""cx cy fx fy, k1 to k6, codx cody, p2 p1: such as cameras have."""
SIZES = {
    "NFOV_2X2BINNED": (320, 288),
    "NFOV_UNBINNED": (640, 576),
    "WFOV_2X2BINNED": (512, 512),
    "WFOV_UNBINNED": (1024, 1024),
}
TAGS = {"K4A_DEVICE_SERIAL_NUMBER": "000123", "K4A_START_OFFSET_NS": "336277000", "K4A_DEPTH_DELAY_NS": "0"}

TIMES_US = [12, 33_345, 66_679, 7_200_000_001]
"""Not whole milliseconds, and two hours later, so that a rounded time stamp shows."""
HOLDING = ("18538067", "1654ae6b", "ae", "1941a469", "61a7", "1f43b675", "a0")
"""Elements that hold others: segment, tracks, track, attachments, attachment, cluster, block group."""


def calibration(parameters: Sequence[object] = PARAMETERS, **changed: object) -> bytes:
    """A calibration.json; changed: of the depth camera's entry."""
    model = {"ModelParameterCount": 14, "ModelParameters": list(parameters)}
    depth = {
        "Intrinsics": {**model, "ModelType": "CALIBRATION_LensDistortionModelBrownConrady"},
        "Location": "CALIBRATION_CameraLocationD0",
        "MetricRadius": 1.74,
        "SensorWidth": 1024,
        "SensorHeight": 1024,
        **changed,
    }
    colour = {"Location": "CALIBRATION_CameraLocationPV0"}
    return json.dumps({"CalibrationInformation": {"Cameras": [colour, depth]}}).encode()


def images(count: int, mode: str) -> list[np.ndarray]:
    """Depth images of a mode, grey values of all sizes."""
    width, height = SIZES[mode]
    values = np.random.default_rng(5).integers(0, 65535, (height, width), dtype=np.uint16)
    return [values + np.uint16(i) for i in range(count)]


def element(name: str, content: bytes) -> bytes:
    """An EBML element: name (hexadecimal), length in eight bytes, content."""
    return bytes.fromhex(name) + (0x01 << 56 | len(content)).to_bytes(8) + content


def number(name: str, value: int) -> bytes:
    return element(name, value.to_bytes(8))


def text(name: str, value: str) -> bytes:
    return element(name, value.encode())


def track(index: int, name: str, width: int, height: int, four_letters: bytes = b"b16g") -> bytes:
    """A video track by its BITMAPINFOHEADER, as the recorder writes it."""
    header = struct.pack("<IiiHH4sIiiII", 40, width, height, 1, 16, four_letters, 2 * width * height, 0, 0, 0, 0)
    size = element("e0", number("b0", width) + number("ba", height))
    described = number("d7", index) + number("73c5", 1000 + index) + number("83", 1) + text("536e", name)
    return element("ae", described + text("86", "V_MS/VFW/FOURCC") + element("63a2", header) + size)


def tag(name: str, value: str, target: bytes = b"") -> bytes:
    return element("7373", element("63c0", target) + element("67c8", text("45a3", name) + text("4487", value)))


def cluster(time_us: int, packets: Sequence[tuple[int, bytes]]) -> bytes:
    """One capture; packets: track and content."""
    blocks = [element("a3", bytes([0x80 | index]) + b"\0\0\x80" + content) for index, content in packets]
    return element("1f43b675", number("e7", time_us) + b"".join(blocks))


def mkv(
    depth: Sequence[np.ndarray],
    times_us: Sequence[int],
    mode: str | None = "NFOV_2X2BINNED",
    *,
    attached: bytes | None = None,
    tags: dict[str, str] = TAGS,
    name: str = "DEPTH",
    four_letters: bytes = b"b16g",
) -> bytes:
    """A recording with colour and infrared beside the depth; mode: the tag; attached: calibration.json."""
    height, width = depth[0].shape
    info = number("2ad7b1", 1000) + text("7ba9", "Azure Kinect") + text("4d80", "test") + text("5741", "k4arecord-1")
    tracks = track(1, "COLOR", 1280, 720, b"MJPG") + track(2, name, width, height, four_letters)
    tracks += track(3, "IR", width, height)
    stated = b"".join(tag(*item) for item in tags.items())
    if mode is not None:
        stated += tag("K4A_DEPTH_MODE", mode, text("63ca", "TRACK") + number("63c5", 1002))
    parts = [element("1549a966", info), element("1654ae6b", tracks)]
    if attached is not None:
        file = text("466e", "calibration.json") + text("4660", "application/octet-stream") + element("465c", attached)
        parts.append(element("1941a469", element("61a7", file + number("46ae", 77))))
    parts.append(element("1254c367", stated))
    infrared = np.full((height, width), 7, dtype=">u2").tobytes()
    for image, time_us in zip(depth, times_us, strict=True):
        packets = [(1, b"\xff\xd8 not a picture"), (2, image.astype(">u2").tobytes()), (3, infrared)]
        parts.append(cluster(time_us, packets))
    head = text("4282", "matroska") + number("4287", 2) + number("4285", 2)
    return element("1a45dfa3", head) + element("18538067", b"".join(parts))


def elements(content: bytes) -> Iterator[tuple[str, bytes]]:
    """The elements of Matroska content by hand: name (hexadecimal) and what is in them, those inside of others too."""
    at = 0
    while at < len(content):
        named = 9 - content[at].bit_length()
        sized = 9 - content[at + named].bit_length()
        name, start = content[at : at + named].hex(), at + named + sized
        length = int.from_bytes(content[at + named : start]) & ((1 << 7 * sized) - 1)
        yield name, content[start : start + length]
        if name in HOLDING:
            yield from elements(content[start : start + length])
        at = start + length


def recording(count: int = 3, mode: str = "NFOV_2X2BINNED", **changed: object) -> bytes:
    return mkv(images(count, mode), TIMES_US[:count], mode, attached=calibration(), **changed)


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path
