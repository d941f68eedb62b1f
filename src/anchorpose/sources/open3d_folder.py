"""Folders as Open3D and Redwood have them: depth images and a JSON file with the camera's ``intrinsic_matrix``.

The matrix is written column by column; ``depth_scale`` there is grey values per metre (Open3D's RGBDVideoMetadata).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from anchorpose.errors import InputError
from anchorpose.lens import Intrinsics
from anchorpose.recording.document import read_json
from anchorpose.sources.grey_images import FrameFile, ImageFiles, first_size, images_in
from anchorpose.sources.image_folder import frame_files
from anchorpose.sources.numbers_in import finite, finite_list
from anchorpose.sources.source import SourceCamera

UNITS_PER_M: Final = 1000.0  # of Redwood's sequences, and what Open3D assumes where nothing is said

LARGEST_JSON: Final = 1_000_000  # bytes; a camera's file has some hundred


def matches(path: Path, head: bytes) -> bool:
    """Whether a folder has ``depth`` and a JSON file with an intrinsic matrix."""
    return path.is_dir() and bool(images_in(path / "depth")) and _camera_file(path) is not None


def open_source(path: Path) -> ImageFiles:
    """Raises InputError where the matrix or the images cannot be used."""
    found = _camera_file(path)
    if found is None:
        raise InputError(path, "holds no JSON file with an intrinsic_matrix", "give the folder that does")
    values, images = read_json(found), images_in(path / "depth")
    width, height = first_size(path / "depth", images)
    stated = (values.get("width", width), values.get("height", height))
    if stated != (width, height):
        problem = f"is for {stated[0]} x {stated[1]} pixels, the depth images have {width} x {height}"
        raise InputError(found, problem, "give the intrinsics of the depth images")
    files, has_times = frame_files(images)
    fps = finite(values.get("fps"))
    if not has_times and fps is not None and 0 < fps <= 1000:
        files, has_times = [FrameFile(file.path, file.time_s / fps) for file in files], True
    units = finite(values.get("depth_scale"))
    notes = [] if units is not None else ["Depth is taken to be in mm, as Open3D does; --depth-scale says otherwise."]
    camera = SourceCamera(
        name=path.resolve().name,
        width=width,
        height=height,
        depth_scale=1.0 / units if units is not None and units > 0 else 1.0 / UNITS_PER_M,
        intrinsics=_lens(found, values),
        model=_text(values.get("device_name")),
        serial=_text(values.get("serial_number")),
        count=len(files),
        has_times=has_times,
    )
    return ImageFiles(path, camera, files, notes)


def _lens(path: Path, values: dict[str, Any]) -> Intrinsics:
    matrix = finite_list(values.get("intrinsic_matrix"), 9)
    if matrix is None or matrix[0] <= 0 or matrix[4] <= 0:
        remedy = "it must be nine numbers, column by column, with focal lengths above 0"
        raise InputError(path, "intrinsic_matrix cannot be used", remedy)
    return Intrinsics(fx=matrix[0], fy=matrix[4], cx=matrix[6], cy=matrix[7])


def _camera_file(path: Path) -> Path | None:
    for file in sorted(path.glob("*.json")):
        if file.is_file() and file.stat().st_size < LARGEST_JSON:
            try:
                values = json.loads(file.read_bytes())
            except (ValueError, RecursionError):
                continue
            if isinstance(values, dict) and "intrinsic_matrix" in values:
                return file
    return None


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""
