"""Depth images: 16-bit grey PNG files, checked to their last byte before they are used.

``DepthFrames`` gives those of several cameras one by one, each camera on its own clock, before frames are paired.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from anchorpose.camera import Camera
from anchorpose.recording.image_content import content_problem, measured_m
from anchorpose.recording.recording import Recording
from anchorpose.recording.regular_file import FileStamp, Unreadable, read_bounded

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_HEADER_BYTES: Final = 33  # signature and the IHDR chunk
_GREY: Final = 0  # PNG's colour type
_DECODED: Final = (b"IHDR", b"IDAT", b"IEND")  # all that a grey image is made of
_OTHER_BYTES: Final = 1 << 20  # for chunks of notes, and for compression that compresses nothing


@dataclass(frozen=True, slots=True, eq=False)
class DepthImage:
    """A depth image, or what is wrong with it."""

    depth_m: np.ndarray | None  # (height, width) float32 metres, 0 = no reading; None where it cannot be used
    problem: str  # empty where it can be used


def read_depth_image(path: Path, camera: Camera) -> DepthImage:
    """The depth image of a file in metres, without what lies beyond the lens's valid radius, and without readings that
    are no measurement (``measured_m``).

    A damaged one is a result with its ``problem``, not an error.
    """
    return _read(path, camera, None, judged=False)


def read_measured_image(path: Path, camera: Camera) -> DepthImage:
    """As ``read_depth_image``; one whose content is not a measurement (``content_problem``) has a ``problem`` too."""
    return _read(path, camera, None, judged=True)


def read_stream_image(recording: Recording, camera: int, position: int) -> DepthImage:
    """A camera's depth image at a position in its stream, as by ``read_measured_image``.

    Raises InputError where the file was replaced since the recording was opened.
    """
    stream = recording.streams[camera]
    listed = None if stream.listed is None else FileStamp(*stream.listed[position].item())
    return _read(stream.files[position], recording.cameras[camera], listed, judged=True)


def _read(path: Path, camera: Camera, listed: FileStamp | None, judged: bool) -> DepthImage:
    try:
        data = read_bounded(path, largest_png(camera.width, camera.height), listed)
    except Unreadable as error:
        return DepthImage(None, str(error))
    grey, problem = decode_grey_png(data, camera.width, camera.height)
    if grey is None:
        return DepthImage(None, problem)
    return image_of_grey(grey, camera, judged)


def image_of_grey(grey: np.ndarray, camera: Camera, judged: bool = True) -> DepthImage:
    """The depth image of grey values (height, width) uint16, without what is beyond the lens's valid radius or is no
    measurement (``measured_m``). judged: one whose content is not a measurement is only a ``problem``."""
    depth_m = measured_m(grey, camera.depth_scale)
    depth_m[~camera.valid_pixels()] = 0.0
    problem = content_problem(grey, depth_m) if judged else ""
    return DepthImage(None, problem) if problem else DepthImage(depth_m, "")


def largest_png(width: int, height: int) -> int:
    """Bytes that the file of a 16-bit grey image may have, also of one that cannot be compressed."""
    return 4 * width * height + _OTHER_BYTES


def decode_grey_png(data: bytes, width: int, height: int) -> tuple[np.ndarray | None, str]:
    """The grey values (height, width) uint16 of a PNG file; or None and what is wrong with it.

    Only the chunks of the image itself reach the decoder, which would mix the frames of an animation into it.
    """
    import cv2

    problem = _header_problem(data[:_HEADER_BYTES], width, height)
    image = b""
    if not problem:
        image, problem = image_chunks(data)
    if problem:
        return None, problem
    grey = cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_UNCHANGED)
    if grey is None or grey.dtype != np.uint16 or grey.shape != (height, width):
        return None, "is damaged inside"
    return grey, ""


def grey_png_size(head: bytes) -> tuple[int, int] | None:
    """Width and height of a PNG file by its first 33 bytes; None where it is not one of 16-bit grey."""
    if len(head) < _HEADER_BYTES or not head.startswith(_SIGNATURE) or head[12:16] != b"IHDR":
        return None
    width, height, bits, colour = struct.unpack(">IIBB", head[16:26])
    return (width, height) if (bits, colour) == (16, _GREY) else None


def _header_problem(head: bytes, wide: int, high: int) -> str:
    """What is wrong with the first 33 bytes; empty where they fit a camera's width and height."""
    if len(head) < _HEADER_BYTES or not head.startswith(_SIGNATURE) or head[12:16] != b"IHDR":
        return "is not a PNG file"
    width, height, bits, colour = struct.unpack(">IIBB", head[16:26])
    if (bits, colour) != (16, _GREY):
        return f"is not 16-bit grey ({bits} bits, colour type {colour})"
    if (width, height) != (wide, high):
        return f"is {width} x {height}, the camera is {wide} x {high} pixels"
    return ""


def image_chunks(data: bytes) -> tuple[bytes, str]:
    """A PNG file with nothing but the chunks that its image needs, and what is wrong with it, empty where nothing is.

    Every chunk is checked up to the end: decoders may return half an image for a truncated file. What may be left out
    (PNG, Section 5.4: names that begin with a small letter) is left out; what may not be, and is unknown, is a problem.
    """
    place, kept, others = len(_SIGNATURE), [data[: len(_SIGNATURE)]], False
    while place + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, place)
        end = place + 8 + length
        if end + 4 > len(data):
            break
        if zlib.crc32(data[place + 4 : end]) != struct.unpack_from(">I", data, end)[0]:
            return b"", "is damaged inside (its checksum is wrong)"
        name = data[place + 4 : place + 8]
        if name in _DECODED:
            kept.append(data[place : end + 4])
        elif name[:1].isupper():
            return b"", f"needs a chunk {name.decode('ascii', 'replace')!r} that grey images do not have"
        others |= name not in _DECODED
        if name == b"IEND":
            return b"".join(kept) if others else data, ""
        place = end + 4
    return b"", "is truncated"


class DepthFrames(Protocol):
    """Anything that gives the depth images of several cameras one by one."""

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras, the reference first."""

    @property
    def times_s(self) -> tuple[np.ndarray, ...]:
        """One per camera: (n,) float64, strictly increasing, its own clock."""

    def read(self, camera: int, position: int) -> np.ndarray | None:
        """(height, width) float32 metres, 0 = no reading; None where the depth image cannot be used."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrames:
    """The depth images of a recording folder; a duplicate shows another moment than its time states and is None."""

    recording: Recording
    cameras: tuple[Camera, ...]  # with the poses to use, which the recording may not have

    @property
    def times_s(self) -> tuple[np.ndarray, ...]:
        """One per camera: (n,) float64, its own clock."""
        return tuple(stream.time_s for stream in self.recording.streams)

    def read(self, camera: int, position: int) -> np.ndarray | None:
        """(height, width) float32 metres, 0 = no reading; None where the depth image cannot be used."""
        stream = self.recording.streams[camera]
        if stream.duplicate is not None and stream.duplicate[position]:
            return None
        return read_stream_image(self.recording, camera, position).depth_m
