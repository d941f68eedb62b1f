"""Folders of Stray Scanner, an app for iPhones and iPads with LiDAR (github.com/strayrobots/scanner, docs/format.md).

Depth is 16-bit PNG in mm; camera_matrix.csv is for the video's pixels, odometry.csv has the time of every image.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.lens import Intrinsics
from anchorpose.recording.document import read_text
from anchorpose.sources.grey_images import FrameFile, ImageFiles, Size, first_size, images_in, number_of
from anchorpose.sources.numbers_in import read_matrix
from anchorpose.sources.source import SourceCamera, movement_note

DEPTH_SCALE_M: Final = 0.001

VIDEO: Final = (1920, 1440)  # what ARKit's camera has on these devices; checked by the principal point

OFF_CENTRE: Final = 0.1  # of the width: real lenses are within 0.02


def matches(path: Path, head: bytes) -> bool:
    """Whether a folder has the app's files."""
    return all((path / name).is_file() for name in ("camera_matrix.csv", "odometry.csv")) and (path / "depth").is_dir()


def open_source(path: Path) -> ImageFiles:
    """Raises InputError where the files do not fit each other."""
    images = images_in(path / "depth")
    size = first_size(path / "depth", images)
    times, positions_m = _odometry(path / "odometry.csv")
    known = {number: file for file in images if (number := number_of(file)) in times}
    files = [FrameFile(file, times[number]) for number, file in sorted(known.items()) if number is not None]
    notes = list(movement_note(positions_m))
    if len(files) < len(images):
        notes.append(f"Depth images without a time in odometry.csv, left out: {len(images) - len(files)}.")
    camera = SourceCamera(
        name=path.resolve().name,
        width=size[0],
        height=size[1],
        depth_scale=DEPTH_SCALE_M,
        intrinsics=scaled_lens(path / "camera_matrix.csv", read_matrix(path / "camera_matrix.csv", 3, 3), VIDEO, size),
        model="iPhone or iPad LiDAR (Stray Scanner)",
        count=len(files),
    )
    return ImageFiles(path, camera, files, notes)


def scaled_lens(path: Path, matrix: np.ndarray, picture: Size, depth: Size) -> Intrinsics:
    """The lens (3, 3) of a colour picture for the depth image that shows the same view with fewer pixels.

    Pixel centres are at whole numbers, so the scale is about the images' corners at -0.5. Raises InputError where the
    matrix is not of a picture of that size, or the shapes differ.
    """
    wide, high = depth[0] / picture[0], depth[1] / picture[1]
    centre = np.array([matrix[0, 2] / picture[0], matrix[1, 2] / picture[1]])
    if np.abs(centre - 0.5).max() > OFF_CENTRE or matrix[0, 0] <= 0 or matrix[1, 1] <= 0 or abs(wide / high - 1) > 0.02:
        problem = f"does not fit colour of {picture[0]} x {picture[1]} and depth of {depth[0]} x {depth[1]} pixels"
        raise InputError(path, problem, "record again, or export the depth images alone and convert their folder")
    return Intrinsics(
        fx=float(matrix[0, 0] * wide),
        fy=float(matrix[1, 1] * high),
        cx=float((matrix[0, 2] + 0.5) * wide - 0.5),
        cy=float((matrix[1, 2] + 0.5) * high - 0.5),
    )


def _odometry(path: Path) -> tuple[dict[int, float], np.ndarray]:
    """Time by frame number, and positions (n, 3) metres; raises InputError where the columns are others."""
    lines = read_text(path).splitlines()
    columns = [cell.strip() for cell in lines[0].split(",")] if lines else []
    if not {"timestamp", "frame", "x", "y", "z"} <= set(columns):
        raise InputError(path, "does not begin with the columns timestamp, frame, x, y, z", "export it again")
    places = [columns.index(name) for name in ("timestamp", "frame", "x", "y", "z")]
    times, positions = dict[int, float](), list[list[float]]()
    for line in lines[1:]:
        cells = line.split(",")
        try:
            time_s, number, *position = (float(cells[place]) for place in places)
        except (ValueError, IndexError):
            continue  # its image has no time then, and is counted among those left out
        if math.isfinite(time_s) and number == number // 1:
            times[int(number)] = time_s
            positions.append(position)
    return times, np.array(positions).reshape(-1, 3)
