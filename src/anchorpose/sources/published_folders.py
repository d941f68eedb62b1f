"""Read folders of depth images in the layouts of public data sets: TUM and ICL-NUIM, Open3D, Redwood and ScanNet.

TUM: a text file lists times and depth images, with grey values in units of 1/5000 m (the benchmark's page on file
formats); the lens is published per sequence, not in the folder. Open3D and Redwood: a folder ``depth`` beside a JSON
file with ``intrinsic_matrix``, stored column by column; ``depth_scale`` in this file is in grey values per metre
(Open3D's RGBDVideoMetadata). ScanNet's reader of .sens files writes the lens to intrinsic/intrinsic_depth.txt, depth in
mm, and the poses of a carried camera in an arbitrary world. If a folder states no times, its images have only numbers.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.lens import Intrinsics
from anchorpose.options import FASTEST_HZ
from anchorpose.recording.document import read_json, read_text
from anchorpose.sources.grey_images import (
    FrameFile,
    ImageFiles,
    Size,
    first_size,
    images_in,
    natural_order,
    number_step,
)
from anchorpose.sources.image_folder import frame_files
from anchorpose.sources.source import (
    MILLIMETRE_M,
    Reader,
    SourceCamera,
    finite,
    finite_list,
    json_object,
    movement_note,
    read_matrix,
    require_counted,
)

TUM_M: Final = 1.0 / 5000.0  # metres per grey value

LISTS: Final = ("depth.txt", "associations.txt", "associate.txt", "associated.txt", "association.txt")

POSES_READ: Final = 100  # number of poses read over the recording, enough to show whether a camera was carried


def _is_tum(path: Path, head: bytes) -> bool:
    """Return whether a folder has a text file that lists depth images, as TUM's folders have."""
    listing = _list_in(path)
    if listing is None:
        return False
    try:
        return bool(_rows(path, read_text(listing)))
    except InputError:
        return False


def _open_tum(path: Path) -> ImageFiles:
    """Open a folder with a list of depth images; raises InputError if the list names no usable depth image."""
    listing = _list_in(path)
    if listing is None:
        raise InputError(path, "holds no depth.txt", "give the folder that does")
    files = _rows(path, read_text(listing))
    notes = ["Depth is taken to be in 1/5000 m, as in TUM's format; --depth-scale replaces it."]
    has_times = any(file.time_s != math.floor(file.time_s) for file in files)
    if not has_times:
        notes.append(f"{listing.name} numbers the images (ICL-NUIM does so at 30 per second) and has no times.")
    there = [file for file in files if file.path.is_file()]
    if len(there) < len(files):
        notes.append(f"Depth images that {listing.name} names and that do not exist: {len(files) - len(there)}.")
    width, height = first_size(path, [file.path for file in there])
    camera = SourceCamera(name=path.resolve().name, width=width, height=height, depth_scale=TUM_M, has_times=has_times)
    return ImageFiles(path, camera, there, notes)


def _list_in(path: Path) -> Path | None:
    return next((path / name for name in LISTS if (path / name).is_file()), None) if path.is_dir() else None


def _rows(folder: Path, text: str) -> list[FrameFile]:
    """Return the depth image named by each line, with its time; some lines also name a colour image and its time."""
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
    """Return the file of an image and its time; None if the time is not a number or the image is outside the folder."""
    try:
        time_s = float(time)
        inside = (folder / name).resolve().is_relative_to(folder.resolve())
    except (ValueError, OSError):
        return None
    if not inside or not math.isfinite(time_s) or Path(name).suffix.lower() not in {".png", ".pgm"}:
        return None
    return FrameFile(folder / name, time_s)


def _is_exported(path: Path, head: bytes) -> bool:
    """Return whether a folder has a subfolder ``depth`` with images, and a file with the camera's lens."""
    return path.is_dir() and bool(images_in(path / "depth")) and _camera_file(path) is not None


def _open_exported(path: Path) -> ImageFiles:
    """Open a folder of Open3D or ScanNet; raises InputError if the camera's matrix or the images cannot be used."""
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
        if not has_times and fps is not None and 0 < fps <= FASTEST_HZ:
            require_counted(path, number_step([file.time_s for file in files]))
            files, has_times = [FrameFile(file.path, file.time_s / fps) for file in files], True
    camera = replace(camera, name=path.resolve().name, has_times=has_times)
    return ImageFiles(path, camera, files, notes)


def _open3d_camera(path: Path, values: dict[str, Any], size: Size) -> tuple[SourceCamera, tuple[str, ...]]:
    width, height = size
    stated = (values.get("width", width), values.get("height", height))
    if stated != size:
        problem = f"is for {stated[0]} x {stated[1]} pixels, the depth images have {width} x {height}"
        raise InputError(path, problem, "give the intrinsics of the depth images")
    units = finite(values.get("depth_scale"))
    notes = () if units is not None else ("Depth is taken to be in mm, as Open3D does; --depth-scale replaces it.",)
    camera = SourceCamera(
        name="",
        width=width,
        height=height,
        depth_scale=1.0 / units if units is not None and units > 0 else MILLIMETRE_M,
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
    return SourceCamera(name="", width=size[0], height=size[1], depth_scale=MILLIMETRE_M, intrinsics=lens)


def _lens(path: Path, values: dict[str, Any]) -> Intrinsics:
    matrix = finite_list(values.get("intrinsic_matrix"), 9)
    if matrix is None or matrix[0] <= 0 or matrix[4] <= 0:
        remedy = "it must be nine numbers, column by column, with focal lengths above 0"
        raise InputError(path, "intrinsic_matrix cannot be used", remedy)
    return Intrinsics(fx=matrix[0], fy=matrix[4], cx=matrix[6], cy=matrix[7])


def _positions(folder: Path) -> np.ndarray:
    """Return the camera's positions (n, 3), metres, in about ``POSES_READ`` of the stored poses. Damaged poses are left
    out without an error, since the positions only serve for a note.
    """
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
    return next((file for file in sorted(path.glob("*.json")) if "intrinsic_matrix" in (json_object(file) or {})), None)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""


def _scannet_file(path: Path) -> Path:
    return path / "intrinsic" / "intrinsic_depth.txt"


READERS: Final = (Reader(_is_tum, _open_tum), Reader(_is_exported, _open_exported))
