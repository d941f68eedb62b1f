"""Folders as ScanNet's reader of .sens files exports them: depth/*.png in mm, intrinsic/intrinsic_depth.txt, pose/.

They hold no times, and poses in a world of their own that changes with a camera that is carried; neither is invented.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.lens import Intrinsics
from anchorpose.sources.grey_images import ImageFiles, first_size, images_in, natural_order
from anchorpose.sources.handheld import movement_note
from anchorpose.sources.image_folder import frame_files
from anchorpose.sources.numbers_in import read_matrix
from anchorpose.sources.source import SourceCamera

DEPTH_SCALE_M: Final = 0.001

POSES_READ: Final = 100  # spread over the recording; enough to see that a camera was carried


def matches(path: Path, head: bytes) -> bool:
    """Whether a folder has depth images and ScanNet's file of the depth camera."""
    return path.is_dir() and _lens_file(path).is_file() and bool(images_in(path / "depth"))


def open_source(path: Path) -> ImageFiles:
    """Raises InputError where the matrix or the images cannot be used."""
    matrix, images = read_matrix(_lens_file(path), 4, 4), images_in(path / "depth")
    if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise InputError(_lens_file(path), "has no focal lengths above 0", "export it again")
    width, height = first_size(path / "depth", images)
    files, has_times = frame_files(images)
    camera = SourceCamera(
        name=path.resolve().name,
        width=width,
        height=height,
        depth_scale=DEPTH_SCALE_M,
        intrinsics=Intrinsics(fx=matrix[0, 0], fy=matrix[1, 1], cx=matrix[0, 2], cy=matrix[1, 2]),
        count=len(files),
        has_times=has_times,
    )
    return ImageFiles(path, camera, files, movement_note(_positions(path / "pose")))


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


def _lens_file(path: Path) -> Path:
    return path / "intrinsic" / "intrinsic_depth.txt"
