"""A folder ``depth`` of images with the camera's matrix in a file beside it, as Open3D, Redwood and ScanNet have it.

Open3D and Redwood: a JSON file with ``intrinsic_matrix``, column by column; ``depth_scale`` there is grey values per
metre (Open3D's RGBDVideoMetadata). ScanNet's reader of .sens files: intrinsic/intrinsic_depth.txt, depth in mm, and
poses in a world of their own that changes with a camera that is carried. Times that neither holds are not invented.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.lens import Intrinsics
from anchorpose.recording.document import parse_json, read_json
from anchorpose.recording.regular_file import Unreadable, read_bounded
from anchorpose.sources.grey_images import FrameFile, ImageFiles, Size, first_size, images_in, natural_order
from anchorpose.sources.image_folder import frame_files
from anchorpose.sources.numbers_in import finite, finite_list, read_matrix
from anchorpose.sources.source import SourceCamera, movement_note

UNITS_PER_M: Final = 1000.0  # of ScanNet and Redwood, and what Open3D assumes where nothing is said

LARGEST_JSON: Final = 1_000_000  # bytes; a camera's file has some hundred

POSES_READ: Final = 100  # spread over the recording; enough to see that a camera was carried


def matches(path: Path, head: bytes) -> bool:
    """Whether a folder has ``depth`` and a file of the camera."""
    return path.is_dir() and bool(images_in(path / "depth")) and _camera_file(path) is not None


def open_source(path: Path) -> ImageFiles:
    """Raises InputError where the matrix or the images cannot be used."""
    found = _camera_file(path)
    if found is None:
        raise InputError(path, "holds no JSON file with an intrinsic_matrix", "give the folder that does")
    images = images_in(path / "depth")
    size = first_size(path / "depth", images)
    files, has_times = frame_files(images)
    if found == _scannet_file(path):
        camera, notes = _scannet_camera(found, size), movement_note(_positions(path / "pose"))
    else:
        values = read_json(found)
        camera, notes = _open3d_camera(found, values, size)
        fps = finite(values.get("fps"))
        if not has_times and fps is not None and 0 < fps <= 1000:
            files, has_times = [FrameFile(file.path, file.time_s / fps) for file in files], True
    camera = replace(camera, name=path.resolve().name, count=len(files), has_times=has_times)
    return ImageFiles(path, camera, files, notes)


def _open3d_camera(path: Path, values: dict[str, Any], size: Size) -> tuple[SourceCamera, tuple[str, ...]]:
    width, height = size
    stated = (values.get("width", width), values.get("height", height))
    if stated != size:
        problem = f"is for {stated[0]} x {stated[1]} pixels, the depth images have {width} x {height}"
        raise InputError(path, problem, "give the intrinsics of the depth images")
    units = finite(values.get("depth_scale"))
    notes = () if units is not None else ("Depth is taken to be in mm, as Open3D does; --depth-scale says otherwise.",)
    camera = SourceCamera(
        name="",
        width=width,
        height=height,
        depth_scale=1.0 / units if units is not None and units > 0 else 1.0 / UNITS_PER_M,
        intrinsics=_lens(path, values),
        model=_text(values.get("device_name")),
        serial=_text(values.get("serial_number")),
    )
    return camera, notes


def _scannet_camera(path: Path, size: Size) -> SourceCamera:
    matrix = read_matrix(path, 4, 4)
    if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise InputError(path, "has no focal lengths above 0", "export it again")
    lens = Intrinsics(fx=matrix[0, 0], fy=matrix[1, 1], cx=matrix[0, 2], cy=matrix[1, 2])
    return SourceCamera(name="", width=size[0], height=size[1], depth_scale=1.0 / UNITS_PER_M, intrinsics=lens)


def _lens(path: Path, values: dict[str, Any]) -> Intrinsics:
    matrix = finite_list(values.get("intrinsic_matrix"), 9)
    if matrix is None or matrix[0] <= 0 or matrix[4] <= 0:
        remedy = "it must be nine numbers, column by column, with focal lengths above 0"
        raise InputError(path, "intrinsic_matrix cannot be used", remedy)
    return Intrinsics(fx=matrix[0], fy=matrix[4], cx=matrix[6], cy=matrix[7])


def _positions(folder: Path) -> np.ndarray:
    """(n, 3) metres of some of the poses; damaged ones are left out, since nothing but a note rests on them."""
    files = sorted(folder.glob("*.txt"), key=natural_order)
    positions = list[np.ndarray]()
    for file in files[:: max(1, len(files) // POSES_READ)]:
        try:
            positions.append(read_matrix(file, 4, 4)[:3, 3])
        except InputError:
            continue
    return np.array(positions).reshape(-1, 3)


def _camera_file(path: Path) -> Path | None:
    if _scannet_file(path).is_file():
        return _scannet_file(path)
    for file in sorted(path.glob("*.json")):
        try:
            values = parse_json(read_bounded(file, LARGEST_JSON), LARGEST_JSON)
        except (Unreadable, ValueError):
            continue
        if isinstance(values, dict) and "intrinsic_matrix" in values:
            return file
    return None


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""


def _scannet_file(path: Path) -> Path:
    return path / "intrinsic" / "intrinsic_depth.txt"
