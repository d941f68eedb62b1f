"""A plain folder of 16-bit grey PNG or PGM images, also in a subfolder ``depth``.

Numbers in the names show which images are missing; a sidecar depth.json may give the lens, the unit and the rate.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.sources.grey_images import FrameFile, ImageFiles, first_size, grey_size, images_in, number_of
from anchorpose.sources.sidecar import SIDECAR, SidecarDocument, camera_of, file_times
from anchorpose.sources.source import SourceCamera

LOOK_AT: Final = 100  # images before a folder counts as one without depth: colour may lie among them

FASTEST_S, SLOWEST_S = 0.003, 1.0
"""What two images of a depth camera may be apart; numbers that say otherwise are not times."""


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


def _images(path: Path) -> list[Path]:
    return images_in(path) or images_in(path / "depth")
