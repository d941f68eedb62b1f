"""Read recordings (``.mkv``) that were made with Azure Kinect's SDK, or with Orbbec's wrapper of this SDK for Femto
cameras.

The file's layout is defined by the published Azure Kinect Sensor SDK (github.com/microsoft/Azure-Kinect-Sensor-SDK,
MIT, ``src/record``): it is a Matroska file. Its track DEPTH has uncompressed, big-endian images in millimetres, its
attachment ``calibration.json`` has the lens, and its tags describe the device. Tracks of colour and infrared are never
decoded. The lens is read as in three files of the SDK: ``src/calibration/calibration.c`` (layout of calibration.json),
``src/transformation/mode_specific_calibration.c`` (cropping, binning and the shift by half a pixel) and
``src/transformation/intrinsic_transformation.c`` (order and meaning of the parameters). Orbbec's wrapper
(github.com/orbbec/OrbbecSDK-K4A-Wrapper) has these files unchanged.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from anchorpose.errors import InputError, MissingPackage
from anchorpose.lens import Intrinsics, LensModel
from anchorpose.recording.document import parse_json
from anchorpose.recording.regular_file import open_regular
from anchorpose.sources.source import MILLIMETRE_M, NO_READING, Reader, SourceCamera, SourceFrame, finite

if TYPE_CHECKING:
    from av import Packet, VideoStream
    from av.container import InputContainer

DEPTH_CAMERA: Final = "CALIBRATION_CameraLocationD0"
MODEL: Final = "CALIBRATION_LensDistortionModelBrownConrady"
"""Name of the only lens model that is read. It has the formula of OpenCV's rational model. Only early internal devices
of the maker had other models.
"""
SENSOR_PX: Final = 1024
"""Width and height of the sensor in pixels. Calibrations of sensors of another size are refused, as by the SDK."""
FOCAL: Final = (0.25, 1.0)
"""Limits of the focal length, divided by the sensor's width; a value beyond them shows that the file is damaged. For a
lens without distortion, the lower limit means a field of view of 127 degrees, the upper limit 53 degrees. The maker
states 120 degrees for its lens, which has distortion; the focal length in a real file is 0.493.
"""


@dataclass(frozen=True, slots=True)
class DepthMode:
    """A mode of the depth camera; each mode reads a part of the sensor. binning: number of sensor pixels per image
    pixel, along each axis; left, top: number of image pixels cropped at the left and at the top.
    """

    name: str
    width: int
    height: int
    binning: int
    left: int
    top: int


MODES: Final = (
    DepthMode("NFOV_2X2BINNED", 320, 288, 2, 96, 90),
    DepthMode("NFOV_UNBINNED", 640, 576, 1, 192, 180),
    DepthMode("WFOV_2X2BINNED", 512, 512, 2, 0, 0),
    DepthMode("WFOV_UNBINNED", 1024, 1024, 1, 0, 0),
)
"""All modes with a depth image; no two modes have the same image size."""


def depth_mode(width: int, height: int) -> DepthMode | None:
    """Return the mode whose images have this size in pixels; None if no mode has this size."""
    return next((mode for mode in MODES if (mode.width, mode.height) == (width, height)), None)


def lens_of(calibration: bytes, mode: DepthMode) -> Intrinsics:
    """Return the depth camera's lens, in pixels of the images of ``mode``.

    calibration: the text of ``calibration.json``. Raises ValueError with the problem, as the end of a sentence that
    begins with the file's name.
    """
    camera = _depth_camera(calibration)
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, centre_x, centre_y, p2, p1 = _parameters(camera)
    if centre_x or centre_y:
        raise ValueError("has a centre of distortion, which this lens model lacks")
    size_px = SENSOR_PX / mode.binning
    # (0, 0) is the corner of the sensor's first pixel in calibration.json, but that pixel's centre in Intrinsics
    return Intrinsics(
        fx=fx * size_px,
        fy=fy * size_px,
        cx=cx * size_px - mode.left - 0.5,
        cy=cy * size_px - mode.top - 0.5,
        distortion=(k1, k2, p1, p2, k3, k4, k5, k6),
        model=LensModel.RATIONAL,
        valid_radius=_radius(camera),
    )


def _depth_camera(calibration: bytes) -> dict:
    """Return the entry of the depth camera in the text of ``calibration.json``; raises ValueError without such an
    entry, or if its sensor does not have ``SENSOR_PX`` pixels per side.
    """
    try:
        document = parse_json(calibration.rstrip(b"\0"))
        cameras = document["CalibrationInformation"]["Cameras"]
        camera = next(entry for entry in cameras if entry["Location"] == DEPTH_CAMERA)
        size = (camera["SensorWidth"], camera["SensorHeight"])
    except (ValueError, LookupError, TypeError, StopIteration):
        raise ValueError("is damaged or has no depth camera") from None
    if size != (SENSOR_PX, SENSOR_PX):
        raise ValueError(f"is not of a sensor of {SENSOR_PX} x {SENSOR_PX} pixels")
    return dict(camera)


def _parameters(camera: dict) -> tuple[float, ...]:
    """Return the fourteen numbers of the depth camera's lens; raises ValueError if they are impossible for a lens."""
    try:
        model = camera["Intrinsics"]["ModelType"]
        numbers = np.array(camera["Intrinsics"]["ModelParameters"], dtype=np.float64)
    except (ValueError, LookupError, TypeError, OverflowError):
        raise ValueError("is damaged: it has no numbers for the lens") from None
    if model != MODEL:
        raise ValueError("is of a lens model that no Azure Kinect was sold with")
    if numbers.shape != (14,) or not np.isfinite(numbers).all():
        raise ValueError("is damaged: it does not have fourteen numbers for the lens")
    if not ((numbers[:2] > 0) & (numbers[:2] < 1) & (numbers[2:4] > FOCAL[0]) & (numbers[2:4] < FOCAL[1])).all():
        raise ValueError("is damaged: its focal length or image centre cannot be this sensor's")
    return tuple(numbers.tolist())


def _radius(camera: dict) -> float | None:
    """Return the largest sqrt(x² + y²) / z of a ray for which the lens was calibrated; None if unknown."""
    radius = finite(camera.get("MetricRadius"))
    return radius if radius is not None and radius > 1e-4 else None


EBML: Final = b"\x1a\x45\xdf\xa3"  # first bytes of a Matroska file
SEGMENT: Final = b"\x18\x53\x80\x67"  # identifier of the element that holds all tracks
AGAIN: Final = "copy it from the recording computer again"
CALIBRATION: Final = "calibration.json"


def matches(path: Path, head: bytes) -> bool:
    """Return whether a file is a Matroska file; ``open_source`` later refuses a file without depth."""
    return head.startswith(EBML)


def open_source(path: Path) -> AzureKinectFile:
    """Read a file's tracks, tags and calibration; raises InputError if the file has no depth, MissingPackage without
    PyAV.
    """
    with _opened(path) as container:
        _, mode = _depth_track(path, container)
        lens, lens_note = _lens(container, mode)
        start_us, start_note = _start_us(container)
        camera = SourceCamera(
            name=re.sub(r"[^\w+-]", "-", path.stem).lstrip("+-") or "camera",
            width=mode.width,
            height=mode.height,
            depth_scale=MILLIMETRE_M,
            intrinsics=lens,
            model=container.metadata.get("title", ""),  # Orbbec's wrapper, too, writes "Azure Kinect"
            serial=container.metadata.get("K4A_DEVICE_SERIAL_NUMBER", ""),
        )
    cut = "" if _is_whole(path) else "the file was cut short, or its recorder did not close it: its end may be missing"
    return AzureKinectFile(path, (camera,), start_us, tuple(filter(None, (lens_note, start_note, cut))))


@dataclass(slots=True, eq=False)
class AzureKinectFile:
    """A recording of one camera. start_us: time of the device's clock at the file's time 0, microseconds; left_out:
    number of damaged depth images. This number changes while frames are read, so the class is not frozen.
    """

    path: Path
    cameras: tuple[SourceCamera, ...]
    start_us: int
    header_notes: tuple[str, ...]
    left_out: int = field(default=0, init=False)

    @property
    def notes(self) -> tuple[str, ...]:
        """Return sentences for the user; they are complete once all frames were read."""
        damaged = f"depth images left out because their size or time is damaged: {self.left_out}"
        return (*self.header_notes, damaged) if self.left_out else self.header_notes

    def frames(self) -> Iterator[SourceFrame]:
        """Yield the depth images in the order of time; only a few images are in memory at once. Damaged images are
        left out, and a note states their number.

        Raises InputError if the file has no depth image that can be read, or if reading the file fails.
        """
        camera = self.cameras[0]
        count = self.left_out = 0
        with _opened(self.path) as container:
            stream, _ = _depth_track(self.path, container)
            tick_us = Fraction(stream.time_base or 0) * 1_000_000
            for packet in self._in_order(container.demux(stream), 2 * camera.width * camera.height):
                count += 1
                time_us = self.start_us + round((packet.pts or 0) * tick_us)
                yield SourceFrame(0, time_us / 1e6, _image(packet, camera.height, camera.width))
        if not count:
            raise InputError(self.path, "holds no depth image that can be read", AGAIN)

    def _in_order(self, packets: Iterator[Packet], size: int) -> Iterator[Packet]:
        """Yield the packets that hold an image of ``size`` bytes. A packet without a time is left out. If a packet's
        time is not later than the previous packet's time, the previous packet or this packet counts as damaged and is
        left out. It is the previous packet if this packet's time is later than the time of the packet before the
        previous packet; otherwise it is this packet.

        A packet is yielded only when the next packet is known. Otherwise, one packet with a far too late time would be
        yielded, and all packets after it would seem too early.
        """
        held: Packet | None = None
        held_time = before = -1
        for packet in packets:
            time = -1 if packet.pts is None else packet.pts
            if packet.size != size or time < 0:
                self.left_out += packet.size > 0  # an empty packet marks the end of the file
            elif time > held_time:
                if held is not None:
                    yield held
                held, held_time, before = packet, time, held_time
            else:
                self.left_out += 1
                if time > before:
                    held, held_time = packet, time
        if held is not None:
            yield held


def _image(packet: Packet, height: int, width: int) -> np.ndarray:
    """Return the image (height, width) uint16 of an uncompressed packet: its bytes are the pixels, so no decoder is
    used.
    """
    depth = np.frombuffer(memoryview(packet), dtype=">u2").reshape(height, width).astype(np.uint16)
    depth[depth == NO_READING] = 0
    return depth


@contextmanager
def _opened(path: Path) -> Iterator[InputContainer]:
    """Open the file with PyAV. Only the decoder of uncompressed images is allowed, so PyAV never decodes colour, not
    even to detect the formats of the tracks.

    Raises InputError for a damaged file, OSError with the file's path if the disk cannot be read.
    """
    try:
        import av
    except ImportError:
        raise MissingPackage("reading an Azure Kinect's recording", "av", "azure") from None
    limits = {"codec_whitelist": "rawvideo"}
    try:
        with (
            open_regular(path) as file,
            av.open(file, mode="r", format="matroska", metadata_errors="replace", options=limits) as container,
        ):
            yield container
    except (av.FFmpegError, OSError, UnicodeError) as error:
        # an OSError of FFmpeg itself means damage, and so does a position outside the file (EINVAL)
        if isinstance(error, OSError) and not isinstance(error, av.FFmpegError) and error.errno != errno.EINVAL:
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise InputError(path, "cannot be read as a Matroska file", AGAIN) from error


def _depth_track(path: Path, container: InputContainer) -> tuple[VideoStream, DepthMode]:
    """Return the depth track, and its mode according to the images' size; raises InputError if a tag states another
    mode.
    """
    stream = next((video for video in container.streams.video if video.metadata.get("title") == "DEPTH"), None)
    if stream is None:
        raise InputError(
            path,
            "is a video without depth: it has no track named DEPTH",
            "give a recording of k4arecorder made with depth, not a colour or infrared video",
        )
    code = stream.codec_context  # None if the codec is unknown
    if code is None or code.name != "rawvideo" or code.pix_fmt != "gray16be":
        problem = "has depth that is not uncompressed in 16 bits, big-endian"
        raise InputError(path, problem, "give the file as the recorder wrote it")
    mode = depth_mode(code.width, code.height)
    if mode is None:
        raise InputError(path, f"has depth images of {code.width} x {code.height}, which no mode has", AGAIN)
    if stream.metadata.get("K4A_DEPTH_MODE", mode.name).upper() != mode.name:  # early recorders wrote 2X2 as 2x2
        raise InputError(path, f"has depth images of {mode.name} but states another mode", AGAIN)
    return stream, mode


def _lens(container: InputContainer, mode: DepthMode) -> tuple[Intrinsics | None, str]:
    """Return the lens and an empty text, or None and the reason why the lens is missing."""
    for attached in container.streams.attachments:
        if attached.name == CALIBRATION or "K4A_CALIBRATION_FILE" in attached.metadata:
            try:
                return lens_of(attached.data or b"", mode), ""
            except ValueError as problem:
                return None, f"no lens: the file's {CALIBRATION} {problem}"
    return None, f"no lens: the file has no attachment {CALIBRATION}"


def _start_us(container: InputContainer) -> tuple[int, str]:
    """Return the time in microseconds that the device's clock showed at the file's time 0, and an empty text. If the
    file does not state this time, return 0 and a note.

    The recorder subtracts the device's time at the file's time 0 from all time stamps, and the SDK's player adds it
    again. The tag K4A_DEPTH_DELAY_NS only serves to pair depth with colour; it does not change the time stamps.
    """
    stated = container.metadata.get("K4A_START_OFFSET_NS", "")
    if re.fullmatch(r"[0-9]{1,19}", stated):
        return int(stated) // 1000, ""
    return 0, "the file does not state when it began on the device's clock: its times begin with the recording"


def _is_whole(path: Path) -> bool:
    """Return whether the file has the length that its Segment (the element that holds all tracks) states; False if the
    Segment states no length, because the recorder was killed.
    """
    with open_regular(path) as file:
        head = file.read(4096)
    start = head.find(SEGMENT) + len(SEGMENT)
    if start < len(SEGMENT) or not head[start : start + 1].strip(b"\0"):
        return False
    # EBML (RFC 8794): the leading zero bits of a length's first byte state how many bytes the length has
    width = 9 - head[start].bit_length()
    unknown = (1 << 7 * width) - 1
    length = int.from_bytes(head[start : start + width]) & unknown
    return length != unknown and start + width + length == path.stat().st_size


READERS: Final = (Reader(matches, open_source),)
