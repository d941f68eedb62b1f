"""Intel RealSense cameras through pyrealsense2: one source for each camera."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from threading import Event
from typing import Any, Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import AnchorposeError, MissingPackage
from anchorpose.lens import Intrinsics
from anchorpose.live.source import LiveCamera, LiveImage
from anchorpose.recording.recording import Recording
from anchorpose.sources.plan import folder_name

WIDTH, HEIGHT, RATE_HZ = 848, 480, 30
STALL_S: Final = 5.0  # a camera that was unplugged gives no more images
GLOBAL_CLOCKS: Final = ("timestamp_domain.global_time", "timestamp_domain.system_time")
"""The device's time as the host's clock, or the host's own: the age of an image is then known."""


@dataclass(frozen=True, slots=True, eq=False)
class RealSense:
    """One camera that was started; device and pipeline are pyrealsense2's."""

    name: str
    cameras: tuple[LiveCamera, ...]
    about: Recording | None
    pipeline: Any

    def images(self, stop: Event) -> Iterator[LiveImage]:
        """See ``LiveSource``."""
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
            raise AnchorposeError(f"the camera does not answer any more ({error}); check its cable") from None
        finally:
            self.pipeline.stop()


def open_realsense(serial: str, about: Recording | None) -> RealSense:
    """The camera with this serial number, the first one where it is empty.

    about: see ``LiveSource``. Raises MissingPackage without pyrealsense2 or the system's libusb, AnchorposeError where
    there is no such camera.
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
    """Starts what ``config`` selects, which may be a file that librealsense plays; rs: the module pyrealsense2."""
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
    found = LiveCamera(camera=camera, model=device.get_info(rs.camera_info.name), serial=number)
    return RealSense(camera.name, (found,), about, pipeline)


def _lens(rs: Any, found: Any) -> Intrinsics:
    """Depth images have no distortion left in all cameras of this maker that are sold."""
    if any(found.coeffs) and found.model != rs.distortion.brown_conrady:
        raise AnchorposeError(f"The camera's lens model ({found.model}) is not known: record with its own program.")
    coefficients = tuple(float(value) for value in found.coeffs)
    return Intrinsics(fx=found.fx, fy=found.fy, cx=found.ppx, cy=found.ppy, distortion=coefficients)


def _taken(depth: Any) -> float:
    """When an image was taken, by ``time.monotonic``; when it arrived, where the device's clock is its own."""
    now_s = time.monotonic()
    if str(depth.get_frame_timestamp_domain()) not in GLOBAL_CLOCKS:
        return now_s
    age_s = time.time() - depth.get_timestamp() / 1000.0
    return now_s - age_s if 0.0 <= age_s < 1.0 else now_s
