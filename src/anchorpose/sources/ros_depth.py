"""Depth of image messages: grey values as they were recorded, or metres made grey values (REP 118, image_transport)."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from anchorpose.recording.depth_image import image_chunks
from anchorpose.sources.bag_file import DamagedBag
from anchorpose.sources.ros_messages import CompressedMessage, ImageMessage
from anchorpose.sources.source import NO_READING

INTEGERS: Final = frozenset({"16UC1", "mono16", "Z16", "z16"})
METRES: Final = "32FC1"
_PNG: Final = b"\x89PNG"
_HEADER: Final = 12  # bytes of compressed_depth_image_transport's own header: format, two parameters


def encoding_of(image: ImageMessage | CompressedMessage) -> str:
    """The encoding, empty for what is no depth image without loss."""
    if isinstance(image, ImageMessage):
        return image.encoding if image.encoding in INTEGERS | {METRES} else ""
    encoding, _, packing = image.format.partition(";")
    lossless = ("compressedDepth" in packing and "rvl" not in packing) or "png" in packing
    return encoding.strip() if lossless and encoding.strip() in INTEGERS | {METRES} else ""


def size_of(image: ImageMessage | CompressedMessage) -> tuple[int, int]:
    """Width and height. Raises DamagedBag."""
    if isinstance(image, ImageMessage):
        return image.width, image.height
    png = _png_of(image)
    if len(png) < 24:
        raise DamagedBag("a compressed image is not complete")
    width, height = struct.unpack(">II", png[16:24])
    return int(width), int(height)


def grey_of(image: ImageMessage | CompressedMessage) -> np.ndarray:
    """(height, width) uint16 of an image whose values are whole numbers, 0 = no reading. Raises DamagedBag."""
    grey = _plain(image, 2) if isinstance(image, ImageMessage) else _decode(_png_of(image))
    grey = grey.astype(np.uint16)
    grey[grey == NO_READING] = 0
    return grey


def metres_of(image: ImageMessage | CompressedMessage) -> np.ndarray:
    """(height, width) float32 of an image in metres, NaN = no reading. Raises DamagedBag."""
    if isinstance(image, ImageMessage):
        metres = _plain(image, 4).astype(np.float32)
    else:
        # the transport packs 1/depth: png = a / depth + b
        a, b = struct.unpack("<ff", bytes(image.data[4:_HEADER]).ljust(8, b"\0"))
        packed = _decode(_png_of(image)).astype(np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            metres = np.where(packed > 0, np.float32(a) / (packed - np.float32(b)), np.float32(np.nan))
    metres[~(np.isfinite(metres) & (metres > 0.0))] = np.nan
    return metres


def _plain(image: ImageMessage, size: int) -> np.ndarray:
    """(height, width) of values of ``size`` bytes, rows perhaps padded."""
    row = image.width * size
    step = image.step or row
    if not 0 < row <= step or image.height == 0 or step * image.height > len(image.data):
        raise DamagedBag("an image has fewer bytes than its size says")
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
