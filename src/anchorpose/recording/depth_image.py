"""Read depth images (16-bit grey PNG files): check every byte of the file, then the content of the image.

A sensor that is blinded, covered or broken still delivers complete files, but their content cannot be a scene. Such
images have no readings, or the same value everywhere, or unrelated values in neighbouring pixels. An image with such
content is left out as if it were missing. The check uses no prediction of the scene, so it is valid for every room and
every pose.

``RecordedFrames`` reads single images with times on the camera's own clock; images of different cameras are paired by
time only later.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.recording.regular_file import Stamp, Unreadable, read_bounded

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_HEADER_BYTES: Final = 33  # length of the signature and the IHDR chunk of a PNG file
_GREY: Final = 0  # code of the colour type grey in a PNG file
_DECODED: Final = (b"IHDR", b"IDAT", b"IEND")  # the only chunks that a decoder needs for a grey image
# bytes allowed in addition to four per pixel: for chunks of text, and for the overhead of compression if pixels are
# incompressible
_OTHER_BYTES: Final = 1 << 20

FARTHEST_M: Final = 20.0
"""Distance in m that no indoor depth camera exceeds: a larger value is an error code, or light from outside."""

SATURATED: Final = np.iinfo(np.uint16).max  # the largest 16-bit value, which is an error code, not a distance
ROWS: Final = 128  # number of checked image rows, evenly spaced; surfaces are many rows high, so no surface is missed
LEAST_READ: Final = 0.001  # minimum share of pixels that must have a reading; a distant person alone fills 0.03
# minimum number of readings for an image to be tested for equal values, missing neighbours and jumps; with fewer
# readings, images without a fault may fail these tests
ENOUGH: Final = 4000
# maximum share of readings that may have the same value; a whole body measured in coarse steps has 0.3
MOST_ALIKE: Final = 0.98
# minimum share of readings that must have another reading at the pixel to their right; real images have 0.93 or more
LEAST_BESIDE: Final = 0.5
# minimum difference of two neighbouring readings that counts as a jump, divided by their distance from the camera.
# Within one surface, only parts that are seen edge-on have larger differences between neighbouring readings
JUMP: Final = 0.1
# maximum share of jumps among pairs of neighbouring readings; real cluttered rooms have up to 0.03
MOST_JUMPS: Final = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class DepthImage:
    """A depth image, or the problem that makes it unusable."""

    depth_m: np.ndarray | None  # (height, width) float32 metres, 0 = no reading; None if unusable
    problem: str  # empty if usable


def read_depth_image(path: Path, camera: Camera, judged: bool = False, listed: Stamp | None = None) -> DepthImage:
    """Read the depth image in a file; if the file is damaged, the result states the ``problem``.

    judged: whether the content is checked, too; an image that cannot be a measurement then has a ``problem``. listed:
    the file's stamp (size, time of change, inode) when the recording was opened. Raises InputError if the file was
    replaced after the recording was opened.
    """
    try:
        data = read_bounded(path, largest_png(camera.width, camera.height), listed)
    except Unreadable as error:
        return DepthImage(None, str(error))
    grey, problem = decode_grey_png(data, camera.width, camera.height)
    return DepthImage(None, problem) if grey is None else image_of_grey(grey, camera, judged)


def read_stream_image(recording: Recording, camera: int, position: int) -> DepthImage:
    """Read the depth image at a position in the stream of the camera with this index, and check its content.

    Raises InputError if the file was replaced since the recording was opened.
    """
    stream = recording.streams[camera]
    listed = None if stream.listed is None else stream.listed[position].item()
    return read_depth_image(stream.files[position], recording.cameras[camera], judged=True, listed=listed)


def image_of_grey(grey: np.ndarray, camera: Camera, judged: bool = True) -> DepthImage:
    """Convert grey values (height, width) uint16 to a depth image. Readings beyond the lens's valid radius and values
    that are not measurements (``measured_m``) become 0.

    judged: whether the content is checked (``content_problem``); an image that fails this check has a ``problem``.
    """
    depth_m = measured_m(grey, camera.depth_scale)
    depth_m[~camera.valid_pixels()] = 0.0
    problem = content_problem(grey, depth_m) if judged else ""
    return DepthImage(None, problem) if problem else DepthImage(depth_m, "")


def frame_set_of_greys(
    frame: int,
    time_s: float,
    cameras: Sequence[Camera],
    greys: Sequence[np.ndarray | None],
    taken_s: Sequence[float | None],
) -> FrameSet:
    """Return the frame set of grey images (height, width) uint16, one per camera, None without an image. An image that
    cannot be used (``image_of_grey``) is left out, with a sentence in the set's ``problems``.

    taken_s: one time per camera on the reference clock, None without an image.
    """
    images = [
        DepthImage(None, "") if grey is None else image_of_grey(grey, camera)
        for grey, camera in zip(greys, cameras, strict=True)
    ]
    return FrameSet(
        frame=frame,
        time_s=time_s,
        depths_m=tuple(image.depth_m for image in images),
        taken_s=tuple(None if image.depth_m is None else own_s for image, own_s in zip(images, taken_s, strict=True)),
        problems=tuple(
            f"camera {camera.name} {image.problem}"
            for camera, image in zip(cameras, images, strict=True)
            if image.problem
        ),
    )


def largest_png(width: int, height: int) -> int:
    """Return the largest possible size in bytes of a 16-bit grey PNG file, even if the image is incompressible."""
    return 4 * width * height + _OTHER_BYTES


def decode_grey_png(data: bytes, width: int, height: int) -> tuple[np.ndarray | None, str]:
    """Return the grey values (height, width) uint16 of a PNG file and an empty text; for an unusable file, None and the
    problem.

    The decoder gets only the chunks of a still image, because it would mix the frames of an animated PNG if it got all
    chunks.
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
    """Return width and height of a PNG file by its first 33 bytes; None unless it is 16-bit grey."""
    header = _png_header(head)
    return header[:2] if header is not None and header[2:] == (16, _GREY) else None


def _png_header(head: bytes) -> tuple[int, int, int, int] | None:
    """Return width, height, bits and colour type from a file's first 33 bytes; None if it is not a PNG file."""
    if len(head) < _HEADER_BYTES or not head.startswith(_SIGNATURE) or head[12:16] != b"IHDR":
        return None
    width, height, bits, colour = struct.unpack(">IIBB", head[16:26])
    return width, height, bits, colour


def _header_problem(head: bytes, wide: int, high: int) -> str:
    """Return the problem that a file's first 33 bytes show; empty if it is a 16-bit grey PNG file of this width and
    height.
    """
    header = _png_header(head)
    if header is None:
        return "is not a PNG file"
    width, height, bits, colour = header
    if (bits, colour) != (16, _GREY):
        return f"is not 16-bit grey ({bits} bits, colour type {colour})"
    return "" if (width, height) == (wide, high) else f"is {width} x {height}, the camera is {wide} x {high} pixels"


def image_chunks(data: bytes) -> tuple[bytes, str]:
    """Return a PNG file reduced to the chunks that its image needs, and its problem (empty if it is sound).

    Every chunk is checked up to the end: decoders may return half an image for a truncated file. Optional chunks (PNG,
    Section 5.4: names that begin with a small letter) are left out; an unknown chunk that is not optional is a problem.
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


def measured_m(grey: np.ndarray, depth_scale: float) -> np.ndarray:
    """Convert grey values (height, width) uint16 to metres (height, width) float32; 0 without a measurement.

    The value 0, the largest 16-bit value, and values beyond ``FARTHEST_M`` are not measurements.
    """
    depth_m = grey.astype(np.float32) * np.float32(depth_scale)
    depth_m[(grey == SATURATED) | (depth_m > FARTHEST_M)] = 0.0
    return depth_m


def content_problem(grey: np.ndarray, depth_m: np.ndarray) -> str:
    """Return why an image cannot be a measurement, as the end of a sentence that begins with the file's name; empty if
    the image may be a measurement.

    grey (height, width) uint16 as the file has it; depth_m (height, width) float32: the same in metres, 0 = no reading.
    """
    step = max(1, len(depth_m) // ROWS)
    values, rows = grey[::step], depth_m[::step]
    read = rows > 0
    count = int(np.count_nonzero(read))
    beside = read[:, :-1] & read[:, 1:]
    if count <= LEAST_READ * rows.size or not _three_in_a_row(read):
        lost = int(np.count_nonzero((values > 0) & ~read))
        return "is saturated or beyond the range of the camera" if 2 * lost > rows.size else "holds no readings"
    if count < ENOUGH:
        return ""
    if int(np.bincount(values[read]).max()) > MOST_ALIKE * count:
        return "has the same value nearly everywhere, so that the sensor was blinded or its values are clipped"
    near, next_to = rows[:, :-1][beside], rows[:, 1:][beside]
    jumps = int(np.count_nonzero(np.abs(near - next_to) > JUMP * np.minimum(near, next_to)))
    if len(near) < LEAST_BESIDE * count or jumps > MOST_JUMPS * len(near):
        return "is noise: neighbouring readings have nothing in common"
    return ""


def _three_in_a_row(read: np.ndarray) -> bool:
    """Return whether any three neighbouring pixels of a row have readings; otherwise the image shows no surface."""
    return bool((read[:, :-2] & read[:, 1:-1] & read[:, 2:]).any())


FRAMES_KEPT: Final = 300  # maximum number of frames in memory; for a Kinect v2, these take 260 MB


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrames:
    """The depth images of a recording folder, read on demand. The latest images read stay in memory, since an
    image may be needed more than once. A duplicate of the previous image is read as None, because it shows an
    earlier moment than its time states.
    """

    recording: Recording
    cameras: tuple[Camera, ...]  # cameras with the poses to use; the recording's cameras may lack poses
    kept: dict[tuple[int, int], np.ndarray | None] = field(init=False, repr=False, default_factory=dict)

    @property
    def times_s(self) -> tuple[np.ndarray, ...]:
        """Return the times (n,) float64 of each camera's images, on its own clock."""
        return tuple(stream.time_s for stream in self.recording.streams)

    def read(self, camera: int, position: int) -> np.ndarray | None:
        """Read a depth image (height, width) float32 metres, 0 = no reading; None if unusable."""
        if (camera, position) not in self.kept:
            if len(self.kept) >= FRAMES_KEPT:
                del self.kept[next(iter(self.kept))]
            duplicate = self.recording.streams[camera].duplicate
            is_copy = duplicate is not None and duplicate[position]
            depth_m = None if is_copy else read_stream_image(self.recording, camera, position).depth_m
            self.kept[camera, position] = depth_m
        return self.kept[camera, position]
