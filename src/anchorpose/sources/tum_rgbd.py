"""Folders as of TUM's RGB-D benchmark, and ICL-NUIM's in the same layout: a text file lists times and depth images.

Depth is in 1/5000 m (the benchmark's file formats page); the lens is published per sequence, not in the folder.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.recording.document import read_text
from anchorpose.sources.grey_images import FrameFile, ImageFiles, first_size
from anchorpose.sources.source import SourceCamera

DEPTH_SCALE_M: Final = 1.0 / 5000.0

LISTS: Final = ("depth.txt", "associations.txt", "associate.txt", "associated.txt", "association.txt")


def matches(path: Path, head: bytes) -> bool:
    """Whether a folder holds such a list."""
    listing = _list_in(path)
    if listing is None:
        return False
    try:
        return bool(_rows(path, read_text(listing)))
    except InputError:
        return False


def open_source(path: Path) -> ImageFiles:
    """Raises InputError where the list names no usable depth image."""
    listing = _list_in(path)
    if listing is None:
        raise InputError(path, "holds no depth.txt", "give the folder that does")
    files = _rows(path, read_text(listing))
    notes = ["Depth is taken to be in 1/5000 m, as TUM's format has it; --depth-scale says otherwise."]
    has_times = any(file.time_s != math.floor(file.time_s) for file in files)
    if not has_times:
        notes.append(f"{listing.name} numbers the images (ICL-NUIM does so at 30 per second) and has no times.")
    there = [file for file in files if file.path.is_file()]
    if len(there) < len(files):
        notes.append(f"Depth images that {listing.name} names and that are not there: {len(files) - len(there)}.")
    width, height = first_size(path, [file.path for file in there])
    camera = SourceCamera(
        name=path.resolve().name,
        width=width,
        height=height,
        depth_scale=DEPTH_SCALE_M,
        count=len(there),
        has_times=has_times,
    )
    return ImageFiles(path, camera, there, notes)


def _list_in(path: Path) -> Path | None:
    return next((path / name for name in LISTS if (path / name).is_file()), None) if path.is_dir() else None


def _rows(folder: Path, text: str) -> list[FrameFile]:
    """Each line's time and depth image; a line of two pairs has a colour image as well."""
    files = list[FrameFile]()
    for line in text.splitlines():
        cells = line.split()
        if not cells or cells[0].startswith("#"):
            continue
        pairs = list(zip(cells[::2], cells[1::2], strict=False))
        named = [pair for pair in pairs if "depth" in pair[1].lower()] or pairs[:1]
        file = _frame_file(folder, *named[0]) if named else None
        if file is not None:
            files.append(file)
    return files


def _frame_file(folder: Path, time: str, name: str) -> FrameFile | None:
    """None where it is not a time and an image inside of the folder."""
    try:
        time_s = float(time)
        inside = (folder / name).resolve().is_relative_to(folder.resolve())
    except (ValueError, OSError):
        return None
    if not inside or not math.isfinite(time_s) or Path(name).suffix.lower() not in {".png", ".pgm"}:
        return None
    return FrameFile(folder / name, time_s)
