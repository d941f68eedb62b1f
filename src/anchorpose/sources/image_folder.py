"""A plain folder of 16-bit grey PNG or PGM images, also in a subfolder ``depth``, and the sidecar that describes them.

Numbers in the names show which images are missing; a sidecar depth.json may give the lens, the unit and the rate.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field

from anchorpose.errors import InputError
from anchorpose.recording.document import Entry, Text, Version, read_document
from anchorpose.recording.recording_file import COARSEST_DEPTH_SCALE_M, FINEST_DEPTH_SCALE_M, LensEntry, Rate, Size
from anchorpose.recording.timestamps import Seconds
from anchorpose.sources.grey_images import FrameFile, ImageFiles, first_size, grey_size, images_in, number_of
from anchorpose.sources.source import SourceCamera

SIDECAR: Final = "depth.json"
"""The name of the sidecar of a folder; that of a single file is the file's name with .json instead of its ending."""

LOOK_AT: Final = 100  # images before a folder counts as one without depth: colour may lie among them

FASTEST_S, SLOWEST_S = 0.003, 1.0
"""What two images of a depth camera may be apart; numbers that say otherwise are not times."""


class SidecarDocument(Entry):
    """``depth-sidecar``: what is known of depth images; ``width`` and ``height`` are needed for raw dumps only."""

    format: Literal["depth-sidecar"]
    version: Version
    width: Size | None = None
    height: Size | None = None
    byte_order: Literal["little", "big"] = "little"
    depth_scale: Annotated[float, Field(ge=FINEST_DEPTH_SCALE_M, le=COARSEST_DEPTH_SCALE_M)] | None = None
    fps: Rate | None = None
    times_s: tuple[Seconds, ...] | None = None
    intrinsics: LensEntry | None = None
    model: Text | None = None
    serial: Text | None = None

    @staticmethod
    def read(path: Path) -> SidecarDocument:
        """Raises InputError naming the key and the remedy."""
        return read_document(path, SidecarDocument)


def matches(path: Path, head: bytes) -> bool:
    """Whether a folder, or its ``depth``, holds 16-bit grey images."""
    return path.is_dir() and any(grey_size(file) is not None for file in _images(path)[:LOOK_AT])


def open_source(path: Path) -> ImageFiles:
    """Raises InputError where the sidecar cannot be used."""
    images = _images(path)
    width, height = first_size(path, images)
    grey = [file for file in images if grey_size(file) is not None]
    notes = [f"Images that are not 16-bit grey were left alone: {len(images) - len(grey)}."] * (len(grey) < len(images))
    files, has_times = frame_files(grey)
    camera = SourceCamera(
        name=path.resolve().name, width=width, height=height, depth_scale=None, count=len(files), has_times=has_times
    )
    if (path / SIDECAR).is_file():
        given = SidecarDocument.read(path / SIDECAR)
        camera, times = camera_of(given, camera, path / SIDECAR), file_times(given, path / SIDECAR, files)
        files = times if times is not None else files
    return ImageFiles(path, camera, files, notes)


def frame_files(images: list[Path]) -> tuple[list[FrameFile], bool]:
    """The images with their times by ``<number>-<microseconds>`` in their names, else their numbers; and whether these
    are times. Images whose names hold no number of their own are counted."""
    stamps = [re.fullmatch(r"\D*\d+-(\d{9,})", file.stem) for file in images]
    micros = [int(stamp[1]) for stamp in stamps if stamp is not None]
    if len(micros) == len(images) > 1 and FASTEST_S < np.median(np.diff(sorted(micros))) / 1e6 < SLOWEST_S:
        timed = sorted(zip(micros, images, strict=True))
        return [FrameFile(file, micro / 1e6) for micro, file in timed], True
    numbers = [number_of(file) for file in images]
    known = [number for number in numbers if number is not None]
    if len(set(known)) < len(images):
        return [FrameFile(file, float(place)) for place, file in enumerate(images)], False
    return [FrameFile(file, float(number)) for number, file in sorted(zip(known, images, strict=True))], False


def camera_of(given: SidecarDocument, camera: SourceCamera, path: Path) -> SourceCamera:
    """``camera`` with what the sidecar ``path`` says; raises InputError where the images have another size."""
    for name, own, said in (("width", camera.width, given.width), ("height", camera.height, given.height)):
        if said is not None and said != own:
            raise InputError(path, f"{name} is {said}, the images have {own}", "correct the number")
    return replace(
        camera,
        depth_scale=given.depth_scale,
        intrinsics=given.intrinsics.lens() if given.intrinsics is not None else None,
        model=given.model or "",
        serial=given.serial or "",
        has_times=camera.has_times or given.times_s is not None or given.fps is not None,
    )


def times_of(given: SidecarDocument, path: Path, numbers: np.ndarray) -> np.ndarray | None:
    """(n,) seconds of images with these numbers, or None; raises InputError where ``times_s`` has another length."""
    if given.times_s is not None:
        if len(given.times_s) != len(numbers):
            problem = f"times_s has {len(given.times_s)} times for {len(numbers)} depth images"
            raise InputError(path, problem, "write one time per image")
        return np.array(given.times_s)
    return None if given.fps is None else numbers / given.fps


def file_times(given: SidecarDocument, path: Path, files: Sequence[FrameFile]) -> list[FrameFile] | None:
    """The files, now numbered, with the sidecar's times; None where it has none."""
    times = times_of(given, path, np.array([file.time_s for file in files]))
    return None if times is None else [replace(file, time_s=t) for file, t in zip(files, times.tolist(), strict=True)]


def _images(path: Path) -> list[Path]:
    return images_in(path) or images_in(path / "depth")
