"""Orbbec cameras through pyorbbecsdk2, which clashes with other packages: in a Python and a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import IO, Any, Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import AnchorposeError
from anchorpose.lens import Intrinsics, LensModel
from anchorpose.live import orbbec_process
from anchorpose.live.source import LiveCamera, LiveImage
from anchorpose.recording.recording import Recording
from anchorpose.sources.plan import folder_name

PYTHON_VARIABLE: Final = "ANCHORPOSE_ORBBEC_PYTHON"
"""The environment variable that names the Python which has pyorbbecsdk2; without it, the one that runs."""


@dataclass(frozen=True, slots=True, eq=False)
class Orbbec:
    """One camera, read by another process."""

    name: str
    cameras: tuple[LiveCamera, ...]
    about: Recording | None
    process: subprocess.Popen[bytes]
    first: bytes  # the header that was read to know the scale

    def images(self, stop: Event) -> Iterator[LiveImage]:
        """See ``LiveSource``."""
        camera, out = self.cameras[0].camera, _out(self.process)
        header = self.first
        try:
            while not stop.is_set() and len(header) == orbbec_process.HEADER.size:
                number, device_us, host_us, scale, size = orbbec_process.HEADER.unpack(header)
                grey = np.frombuffer(_read(out, size), np.uint16).reshape(camera.height, camera.width)
                if not np.isclose(scale, camera.depth_scale):
                    raise AnchorposeError("the camera changed its unit of depth; start again")
                taken_s = time.monotonic() - max(time.time() - host_us / 1e6, 0.0)
                yield LiveImage(0, number, device_us / 1e6, taken_s, grey)
                header = _read(out, orbbec_process.HEADER.size)
            if not stop.is_set():
                raise AnchorposeError(_why_ended(self.process))
        finally:
            self.process.terminate()
            self.process.wait(timeout=5.0)


def open_orbbec(serial: str, about: Recording | None, command: Sequence[str] = ()) -> Orbbec:
    """The camera with this serial number, the first one where it is empty.

    about: see ``LiveSource``; command: instead of the process that reads the camera. Raises AnchorposeError where there
    is no such camera, or that Python has no pyorbbecsdk2.
    """
    python = os.environ.get(PYTHON_VARIABLE, sys.executable)
    command = command or (python, str(Path(orbbec_process.__file__)), *([serial] if serial else []))
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    out = _out(process)
    line = out.readline()
    if not line:
        raise AnchorposeError(_why_ended(process))
    found = json.loads(line)
    first = _read(out, orbbec_process.HEADER.size)
    if len(first) < orbbec_process.HEADER.size:
        raise AnchorposeError(_why_ended(process))
    camera = _camera(found, orbbec_process.HEADER.unpack(first)[3])
    live = LiveCamera(camera=camera, model=found["name"], serial=found["serial"])
    return Orbbec(camera.name, (live,), about, process, first)


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
        raise ValueError("the process was started with a pipe")
    return process.stdout


def _read(stream: IO[bytes], size: int) -> bytes:
    """So many bytes, fewer where the stream ends."""
    return stream.read(size)


def _why_ended(process: subprocess.Popen[bytes]) -> str:
    """What the process said last; it ends by itself."""
    process.wait(timeout=10.0)
    said = b"" if process.stderr is None else process.stderr.read()
    last = said.decode(errors="replace").strip().splitlines()[-1:] or ["the process that reads it ended"]
    if "pyorbbecsdk" in last[0] and "Error" in last[0]:
        return (
            "An Orbbec camera needs the package pyorbbecsdk2 in a Python of its own: make one with 'python -m venv', "
            f"install it there, and name that Python in the variable {PYTHON_VARIABLE}."
        )
    return f"The Orbbec camera cannot be read: {last[0]}."
