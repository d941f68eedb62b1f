"""What a person writes beside images or raw dumps that say nothing about themselves: lens, unit, size and times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field

from anchorpose.errors import InputError
from anchorpose.recording.document import Entry, Text, Version, read_document
from anchorpose.recording.recording_file import COARSEST_DEPTH_SCALE_M, LensEntry, Rate, Size
from anchorpose.sources.grey_images import FrameFile
from anchorpose.sources.source import SourceCamera

SIDECAR: Final = "depth.json"
"""The name of the sidecar of a folder; that of a single file is the file's name with .json instead of its ending."""


class SidecarDocument(Entry):
    """``depth-sidecar``: what is known of depth images; ``width`` and ``height`` are needed for raw dumps only."""

    format: Literal["depth-sidecar"]
    version: Version
    width: Size | None = None
    height: Size | None = None
    byte_order: Literal["little", "big"] = "little"
    depth_scale: Annotated[float, Field(gt=0, le=COARSEST_DEPTH_SCALE_M)] | None = None
    fps: Rate | None = None
    times_s: tuple[float, ...] | None = None
    intrinsics: LensEntry | None = None
    model: Text | None = None
    serial: Text | None = None

    @staticmethod
    def read(path: Path) -> SidecarDocument:
        """Raises InputError naming the key and the remedy."""
        return read_document(path, SidecarDocument)


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
