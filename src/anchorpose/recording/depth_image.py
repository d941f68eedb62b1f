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
from anchorpose.recording.recording import Recording

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_HEADER_BYTES: Final = 33  # signature and the IHDR chunk
_GREY: Final = 0  # PNG's colour type


@dataclass(frozen=True, slots=True, eq=False)
class DepthImage:
    """A depth image, or what is wrong with it."""

    depth_m: np.ndarray | None  # (height, width) float32 metres, 0 = no reading; None where it cannot be used
    problem: str  # empty where it can be used


def read_depth_image(path: Path, camera: Camera) -> DepthImage:
    """The depth image of a file in metres, without what lies beyond the lens's valid radius.

    A damaged one is a result with its ``problem``, not an error.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        return DepthImage(None, f"cannot be read ({error.strerror})")
    grey, problem = decode_grey_png(data, camera.width, camera.height)
    if grey is None:
        return DepthImage(None, problem)
    return DepthImage(depth_of_grey(grey, camera), "")


def depth_of_grey(grey: np.ndarray, camera: Camera) -> np.ndarray:
    """(height, width) float32 metres of grey values (height, width) uint16; 0 = no reading, also beyond the lens's
    valid radius."""
    depth_m = grey.astype(np.float32) * np.float32(camera.depth_scale)
    depth_m[~camera.valid_pixels()] = 0.0
    return depth_m


def decode_grey_png(data: bytes, width: int, height: int) -> tuple[np.ndarray | None, str]:
    """The grey values (height, width) uint16 of a PNG file; or None and what is wrong with it."""
    import cv2

    problem = _header_problem(data[:_HEADER_BYTES], width, height) or _chunk_problem(data)
    if problem:
        return None, problem
    grey = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if grey is None or grey.dtype != np.uint16 or grey.shape != (height, width):
        return None, "is damaged inside"
    return grey, ""


def grey_png_size(head: bytes) -> tuple[int, int] | None:
    """Width and height of a PNG file by its first 33 bytes; None where it is not one of 16-bit grey."""
    if len(head) < _HEADER_BYTES or not head.startswith(_SIGNATURE) or head[12:16] != b"IHDR":
        return None
    width, height, bits, colour = struct.unpack(">IIBB", head[16:26])
    return (width, height) if (bits, colour) == (16, _GREY) else None


def read_header_problem(path: Path, camera: Camera) -> str:
    """What is wrong with the first bytes of a depth image, which is not decoded; empty where nothing is."""
    try:
        with path.open("rb") as file:
            return _header_problem(file.read(_HEADER_BYTES), camera.width, camera.height)
    except OSError as error:
        return f"cannot be read ({error.strerror})"


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


def _chunk_problem(data: bytes) -> str:
    """What is wrong with any chunk up to the end: decoders may return half an image for a truncated file."""
    place = len(_SIGNATURE)
    while place + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, place)
        end = place + 8 + length
        if end + 4 > len(data):
            break
        if zlib.crc32(data[place + 4 : end]) != struct.unpack_from(">I", data, end)[0]:
            return "is damaged inside (its checksum is wrong)"
        if data[place + 4 : place + 8] == b"IEND":
            return ""
        place = end + 4
    return "is truncated"


def is_whole_png(data: bytes) -> bool:
    """Whether data are a PNG file from its first to its last byte."""
    return data.startswith(_SIGNATURE) and not _chunk_problem(data)


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
        return read_depth_image(stream.files[position], self.recording.cameras[camera]).depth_m
