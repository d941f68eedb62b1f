"""Provide sources of depth images: Intel RealSense, Orbbec, and a recording that is played in real time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from threading import Event, Thread
from typing import IO, Any, Final

import numpy as np

from anchorpose.calibration.clocks import ClockConfig, settle_clocks
from anchorpose.camera import Camera
from anchorpose.errors import AnchorposeError, MissingPackage
from anchorpose.lens import Intrinsics, LensModel
from anchorpose.live import orbbec_process
from anchorpose.live.feed import STALL_S, LiveImage
from anchorpose.recording.depth_image import decode_grey_png, largest_png
from anchorpose.recording.recording import Recording
from anchorpose.recording.regular_file import Unreadable, read_bounded
from anchorpose.sources.plan import CameraPlan, folder_name

WIDTH, HEIGHT, RATE_HZ = 848, 480, 30
GLOBAL_CLOCKS: Final = ("timestamp_domain.global_time", "timestamp_domain.system_time")
"""Clock domains of librealsense that give times on the computer's clock, so that an image's age is known."""


@dataclass(slots=True, eq=False)
class RealSense:
    """A started RealSense camera. cameras: a tuple with only this camera; about: a recording with facts about the room
    and the patient that also apply to this camera, or None; pipeline: the object of pyrealsense2 that delivers the
    images.
    """

    name: str
    cameras: tuple[CameraPlan, ...]
    about: Recording | None
    pipeline: Any

    def images(self, stop: Event) -> Iterator[LiveImage]:
        """Yield the images as they are taken, until ``stop`` is set. Raises AnchorposeError with the reason if the
        camera stops answering.
        """
        last_s = time.monotonic()
        try:
            while not stop.is_set():
                arrived, frames = self.pipeline.try_wait_for_frames(200)
                now_s = time.monotonic()
                depth = frames.get_depth_frame() if arrived else None
                if not depth:
                    if now_s - last_s > STALL_S:
                        raise AnchorposeError(f"no image came for {STALL_S:.0f} s; check its cable")
                    continue
                last_s = now_s
                grey = np.array(np.asanyarray(depth.get_data()), np.uint16)
                yield LiveImage(0, int(depth.get_frame_number()), depth.get_timestamp() / 1000.0, _taken(depth), grey)
        except RuntimeError as error:
            raise AnchorposeError(f"the camera no longer answers ({error}); check its cable") from None
        finally:
            with suppress(RuntimeError):  # librealsense has stopped already if the camera was unplugged
                self.pipeline.stop()


def open_realsense(serial: str, about: Recording | None) -> RealSense:
    """Open the camera with this serial number, or the first camera if ``serial`` is empty.

    about: a recording with facts about the room and the patient that also apply to this camera, or None. Raises
    MissingPackage if pyrealsense2 or the system's libusb is missing, AnchorposeError if the camera cannot be started,
    for example because it does not exist, or if its lens model is unknown.
    """
    try:
        import pyrealsense2 as rs
    except ImportError:
        raise MissingPackage("An Intel RealSense camera", "pyrealsense2", "realsense") from None
    config = rs.config()
    if serial:
        config.enable_device(serial)
    config.enable_stream(rs.stream.depth, WIDTH, HEIGHT, rs.format.z16, RATE_HZ)
    return start(rs, config, about, serial)


def start(rs: Any, config: Any, about: Recording | None, serial: str = "") -> RealSense:
    """Start the depth stream that ``config`` selects, from a camera or from a recorded file that librealsense plays.
    rs: the module pyrealsense2.
    """
    pipeline = rs.pipeline()
    try:
        profile = pipeline.start(config)
    except RuntimeError as error:
        which = f"RealSense camera {serial}" if serial else "RealSense camera"
        problem = f"No {which} can be started ({error}); check its cable, and that no other program uses it."
        raise AnchorposeError(problem) from None
    device = profile.get_device()
    stream = profile.get_stream(rs.stream.depth).as_video_stream_profile()
    number = device.get_info(rs.camera_info.serial_number)
    camera = Camera(
        name=folder_name(f"realsense-{number}"),
        width=stream.width(),
        height=stream.height(),
        depth_scale=float(device.first_depth_sensor().get_depth_scale()),
        intrinsics=_lens(rs, stream.get_intrinsics()),
    )
    found = CameraPlan(camera=camera, model=device.get_info(rs.camera_info.name), serial=number)
    return RealSense(camera.name, (found,), about, pipeline)


def _lens(rs: Any, found: Any) -> Intrinsics:
    """Return the lens as ``Intrinsics``. Depth images of RealSense cameras usually have no distortion. If the camera
    states a distortion, its distortion model must be Brown-Conrady; raises AnchorposeError for any other model.
    """
    if any(found.coeffs) and found.model != rs.distortion.brown_conrady:
        raise AnchorposeError(f"The camera's lens model ({found.model}) is not known: record with its own program.")
    coefficients = tuple(float(value) for value in found.coeffs)
    return Intrinsics(fx=found.fx, fy=found.fy, cx=found.ppx, cy=found.ppy, distortion=coefficients)


def _taken(depth: Any) -> float:
    """Return the time at which an image was taken, by ``time.monotonic``. Return the present time instead if the
    time stamp is not on the computer's clock, or if it is 1 s old or older, or in the future.
    """
    now_s = time.monotonic()
    if str(depth.get_frame_timestamp_domain()) not in GLOBAL_CLOCKS:
        return now_s
    age_s = time.time() - depth.get_timestamp() / 1000.0
    return now_s - age_s if 0.0 <= age_s < 1.0 else now_s


PYTHON_VARIABLE: Final = "ANCHORPOSE_ORBBEC_PYTHON"
"""Name of the environment variable that holds the path of a Python interpreter with pyorbbecsdk2; if the variable is
not set, the interpreter that runs this program is used.
"""


@dataclass(slots=True, eq=False)
class Orbbec:
    """An Orbbec camera that another process reads (``orbbec_process``). cameras: a tuple with only this camera; errors:
    the file that holds the process's standard error.
    """

    name: str
    cameras: tuple[CameraPlan, ...]
    about: Recording | None
    process: subprocess.Popen[bytes]
    errors: IO[bytes]
    first: bytes  # header of the first image; ``open_orbbec`` reads this header, since it states the depth scale
    _asked_s: float = np.inf  # when waiting for an image began, by time.monotonic; inf if no image is awaited

    def images(self, stop: Event) -> Iterator[LiveImage]:
        """Yield the images as they are taken, until ``stop`` is set. Raises AnchorposeError with the reason if the
        camera or the process that reads it delivers no more images.
        """
        watching = Thread(target=self._end_process, args=(stop,), daemon=True)
        watching.start()
        header = self.first
        try:
            while len(header) == orbbec_process.HEADER.size:
                number, device_us, host_us, scale, size = orbbec_process.HEADER.unpack(header)
                if (grey := self._grey(scale, size)) is None:
                    break
                taken_s = time.monotonic() - max(time.time() - host_us / 1e6, 0.0)
                yield LiveImage(0, number, device_us / 1e6, taken_s, grey)
                header = self._read(orbbec_process.HEADER.size)
            if not stop.is_set():
                stalled = f"no image came for {STALL_S:.0f} s; check its cable" if self._stalled else ""
                raise AnchorposeError(stalled or _why_ended(self.process, self.errors))
        finally:
            self.process.kill()
            watching.join()
            self.errors.close()

    def _grey(self, scale: float, size: int) -> np.ndarray | None:
        """Read an image of ``size`` bytes, with ``scale`` metres per grey value, from the process; return None if the
        process ends before the last byte.
        """
        camera = self.cameras[0].camera
        if size != 2 * camera.height * camera.width or not np.isclose(scale, camera.depth_scale):
            raise AnchorposeError("the camera changed its image size or its unit of depth; start again")
        data = self._read(size)
        return np.frombuffer(data, np.uint16).reshape(camera.height, camera.width) if len(data) == size else None

    def _read(self, size: int) -> bytes:
        self._asked_s = time.monotonic()
        data = _out(self.process).read(size)
        if len(data) == size:
            self._asked_s = np.inf
        return data

    def _end_process(self, stop: Event) -> None:
        """End the process when ``stop`` is set or no image came for ``STALL_S`` seconds. When the process has ended,
        ``_read`` stops waiting for its output.
        """
        while self.process.poll() is None:
            if stop.wait(0.1) or self._stalled:
                self.process.kill()
                self.process.wait()

    @property
    def _stalled(self) -> bool:
        return time.monotonic() - self._asked_s > STALL_S


def open_orbbec(serial: str, about: Recording | None, command: Sequence[str] = ()) -> Orbbec:
    """Open the camera with this serial number, or the first camera if ``serial`` is empty.

    about: a recording with facts about the room and the patient that also apply to this camera, or None; command:
    command line of the process that reads the camera, empty for ``orbbec_process``. Raises AnchorposeError if the
    process ends before the first image, for example because no such camera is found or its Python has no pyorbbecsdk2,
    or if the first line that the process writes is not a JSON object.
    """
    python = os.environ.get(PYTHON_VARIABLE, sys.executable)
    command = command or (python, str(Path(orbbec_process.__file__)), *([serial] if serial else []))
    # standard error goes to a file, not to a pipe: this program does not read it meanwhile, and a full pipe would block
    # the process
    errors = TemporaryFile()  # noqa: SIM115 closed by ``Orbbec.images``
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors)
    out = _out(process)
    line = out.readline()
    if not line:
        raise AnchorposeError(_why_ended(process, errors))
    found = _found(line, process, errors)
    first = out.read(orbbec_process.HEADER.size)
    if len(first) < orbbec_process.HEADER.size:
        raise AnchorposeError(_why_ended(process, errors))
    camera = _camera(found, orbbec_process.HEADER.unpack(first)[3])
    live = CameraPlan(camera=camera, model=found["name"], serial=found["serial"])
    return Orbbec(camera.name, (live,), about, process, errors, first)


def _found(line: bytes, process: subprocess.Popen[bytes], errors: IO[bytes]) -> dict[str, Any]:
    """Return the description of the camera from the first line that the process wrote. If this line is not a JSON
    object, end the process and raise AnchorposeError.
    """
    try:
        return dict(json.loads(line))
    except (ValueError, TypeError):
        process.kill()
        process.wait()
        errors.close()
    text = line.decode(errors="replace").strip()[:80]
    problem = f"The Orbbec camera cannot be read: its process began with {text!r} instead of the camera's lens"
    remedy = f"name a Python that prints nothing when it starts in the variable {PYTHON_VARIABLE}"
    raise AnchorposeError(f"{problem}; {remedy}.")


def _camera(found: dict[str, Any], scale: float) -> Camera:
    fx, fy, cx, cy = found["intrinsics"]
    distortion = tuple(found["distortion"])
    model = LensModel.RATIONAL if any(distortion[5:]) else LensModel.BROWN_CONRADY
    if model is LensModel.BROWN_CONRADY:
        distortion = distortion[:5]
    lens = Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, model=model, distortion=distortion)
    width, height = found["width"], found["height"]
    name = folder_name(f"orbbec-{found['serial']}")
    return Camera(name=name, width=width, height=height, depth_scale=scale, intrinsics=lens)


def _out(process: subprocess.Popen[bytes]) -> IO[bytes]:
    if process.stdout is None:
        raise ValueError("the process must be started with stdout=PIPE")
    return process.stdout


def _why_ended(process: subprocess.Popen[bytes], errors: IO[bytes]) -> str:
    """Return a sentence on why a process ended, from the last line of its standard error."""
    process.wait(timeout=10.0)
    errors.seek(0)
    last = errors.read().decode(errors="replace").strip().splitlines()[-1:] or ["the process that reads it ended"]
    if "pyorbbecsdk" in last[0] and "Error" in last[0]:
        return (
            "An Orbbec camera needs the package pyorbbecsdk2 in a separate Python: make one with 'python -m venv', "
            f"install it there, and name that Python in the variable {PYTHON_VARIABLE}."
        )
    return f"The Orbbec camera cannot be read: {last[0]}."


LATE_S: Final = 0.25
"""Maximum delay in s with which an image is played. Images with a longer delay are dropped, since a real camera also
overwrites images that were not read in time.
"""


class Playback:
    """A source that plays a recording in real time: the images come at their recorded intervals. Damaged images are
    left out, and so are images that are late by more than ``LATE_S``.
    """

    def __init__(self, recording: Recording) -> None:
        self.name = recording.folder.resolve().name
        self.recording = recording
        self.about: Recording | None = recording
        self.cameras = tuple(CameraPlan(camera=camera) for camera in recording.cameras)
        timed, _ = settle_clocks(recording, recording.cameras, ClockConfig())  # puts all cameras on one clock
        shown_s = [stream.time_s for stream in timed.streams]
        self._order = sorted(
            (float(when), camera, place) for camera, times in enumerate(shown_s) for place, when in enumerate(times)
        )

    def images(self, stop: Event) -> Iterator[LiveImage]:
        """Yield the images at their recorded intervals, until the recording ends or ``stop`` is set."""
        first_s, began_s = self._order[0][0], time.monotonic()
        for when, camera, place in self._order:
            due_s = began_s + when - first_s
            if stop.wait(max(due_s - time.monotonic(), 0.0)):
                return
            if time.monotonic() - due_s > LATE_S:
                continue
            grey = self._read(camera, place)
            if grey is not None:
                stream = self.recording.streams[camera]
                yield LiveImage(camera, int(stream.frame[place]), float(stream.time_s[place]), due_s, grey)

    def _read(self, camera: int, place: int) -> np.ndarray | None:
        stream, seen = self.recording.streams[camera], self.recording.cameras[camera]
        try:
            data = read_bounded(stream.files[place], largest_png(seen.width, seen.height))
        except Unreadable:
            return None
        return decode_grey_png(data, seen.width, seen.height)[0]
