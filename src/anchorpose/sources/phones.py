"""Read recordings of apps for iPhones and iPads with LiDAR: folders of Stray Scanner, .r3d files of Record3D.

Stray Scanner (github.com/strayrobots/scanner, docs/format.md): depth is 16-bit PNG in mm, camera_matrix.csv has the
lens in pixels of the video, odometry.csv has the time of every image. Record3D (record3d.app): a zip with ``metadata``
(JSON) and rgbd/<n>.depth, metres as float32 packed with LZFSE. In the metadata, the lens matrix K is written column by
column, for the colour image of w x h pixels; dw x dh is the size of the depth images.
"""

from __future__ import annotations

import errno
import lzma
import math
import re
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError, MissingPackage
from anchorpose.lens import Intrinsics
from anchorpose.options import FASTEST_HZ
from anchorpose.recording.document import parse_json, read_rows
from anchorpose.recording.recording_file import LARGEST_SIDE_PX
from anchorpose.sources.grey_images import (
    GREY_M,
    FrameFile,
    ImageFiles,
    Size,
    first_size,
    images_in,
    number_of,
    to_grey,
)
from anchorpose.sources.source import (
    MILLIMETRE_M,
    Reader,
    SourceCamera,
    finite,
    finite_list,
    movement_note,
    read_matrix,
)

VIDEO: Final = (1920, 1440)  # pixels, size of these devices' colour image; the principal point must be near the middle

# maximum distance of the principal point from the middle, as a share of the image's size; real lenses have up to 0.02
OFF_CENTRE: Final = 0.1

LARGEST_METADATA: Final = 100_000_000  # bytes, maximum size of the metadata; an hour at 60 images per second has 30 MB
_DAMAGE: Final = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    ArithmeticError,
    EOFError,
    LookupError,
    OSError,
    RuntimeError,
    ValueError,
)
"""Errors that the libraries raise for damaged zip files and damaged JSON."""

_REMEDY: Final = "export it again from Record3D"


def _is_stray(path: Path, head: bytes) -> bool:
    """Return whether a path is a folder of the app Stray Scanner, judged by the files in the folder."""
    return all((path / name).is_file() for name in ("camera_matrix.csv", "odometry.csv")) and (path / "depth").is_dir()


def _open_stray(path: Path) -> ImageFiles:
    """Open a folder of Stray Scanner; raises InputError if the files contradict each other."""
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
        depth_scale=MILLIMETRE_M,
        intrinsics=scaled_lens(path / "camera_matrix.csv", read_matrix(path / "camera_matrix.csv", 3, 3), VIDEO, size),
        model="iPhone or iPad LiDAR (Stray Scanner)",
    )
    return ImageFiles(path, camera, files, notes)


def scaled_lens(path: Path, matrix: np.ndarray, picture: Size, depth: Size) -> Intrinsics:
    """Scale the lens matrix (3, 3) of a colour image to the depth image that shows the same view with fewer pixels.

    picture, depth: sizes of the colour image and of the depth image. Pixel centres have whole-numbered coordinates, so
    the images are scaled about their common corner at -0.5. Raises InputError if the matrix is impossible for a colour
    image of this size, or if the ratios of width to height differ.
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
    """Read times by frame number, and the device's positions (n, 3) in m; raises InputError if a column is missing."""
    (_, columns), *rows = read_rows(path) or [(1, [])]
    if not {"timestamp", "frame", "x", "y", "z"} <= set(columns):
        raise InputError(path, "does not begin with the columns timestamp, frame, x, y, z", "export it again")
    places = [columns.index(name) for name in ("timestamp", "frame", "x", "y", "z")]
    times, positions = dict[int, float](), list[list[float]]()
    for _, cells in rows:
        try:
            time_s, number, *position = (float(cells[place]) for place in places)
        except (ValueError, IndexError):
            continue  # the image of this row has no time, so it counts as left out
        if math.isfinite(time_s) and number == number // 1:
            times[int(number)] = time_s
            positions.append(position)
    return times, np.array(positions).reshape(-1, 3)


def _is_record3d(path: Path, head: bytes) -> bool:
    """Return whether a file is a zip archive with Record3D's files."""
    if not head.startswith(b"PK\x03\x04"):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except _DAMAGE:
        return path.suffix.lower() == ".r3d"  # a damaged zip is recognised, too; opening it then reports the damage
    return "metadata" in names and any(name.startswith("rgbd/") for name in names)


def _open_record3d(path: Path) -> ImageFiles:
    """Open a file of Record3D; raises InputError if the file cannot be used, MissingPackage if lzfse is missing."""
    try:
        import lzfse  # noqa: F401
    except ImportError:
        raise MissingPackage(f"Reading {path.name}", "lzfse", "record3d") from None
    values, names = _contents(path)
    size, picture = (
        (_whole(path, values, wide), _whole(path, values, high)) for wide, high in (("dw", "dh"), ("w", "h"))
    )
    columns = finite_list(values.get("K"), 9)
    if columns is None:
        raise InputError(path, "K in its metadata is not nine numbers", _REMEDY)
    times_s, timed = _times(path, values, [_number(name) for name in names])
    camera = SourceCamera(
        name=path.resolve().stem,
        width=size[0],
        height=size[1],
        depth_scale=GREY_M,
        intrinsics=scaled_lens(path, np.array(columns).reshape(3, 3).T, picture, size),
        model="iPhone or iPad (Record3D)",
        has_times=timed,
    )
    files = [FrameFile(Path(name), time_s) for name, time_s in zip(names, times_s, strict=True)]
    archive = zipfile.ZipFile(path)  # stays open for ``_decode``; Python closes the file when the source is deleted
    notes = movement_note(_positions(values))
    return ImageFiles(path, camera, files, notes, lambda position: _decode(archive, names[position], camera))


def _contents(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the metadata of a Record3D file, and the names of its depth images in the order of their numbers."""
    try:
        with zipfile.ZipFile(path) as archive:
            values = parse_json(_read(archive, "metadata", LARGEST_METADATA), LARGEST_METADATA)
            names = [name for name in archive.namelist() if re.fullmatch(r"rgbd/\d{1,9}\.depth", name)]
    except _DAMAGE:
        raise InputError(path, "is damaged, or not finished", _REMEDY) from None
    if not isinstance(values, dict) or not names:
        raise InputError(path, "holds no depth images", _REMEDY)
    return values, sorted(names, key=_number)


def _read(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    """Read a file of the archive; raises ValueError if its stated size is more than ``most``: the archive may be
    damaged, and zipfile allocates the stated size.
    """
    info = archive.getinfo(name)
    if max(info.file_size, info.compress_size) > most:
        raise ValueError(f"{name} cannot be that large")
    return archive.read(name)


def _number(name: str) -> int:
    return int(name.removeprefix("rgbd/").removesuffix(".depth"))


def _whole(path: Path, values: dict[str, Any], key: str) -> int:
    number = finite(values.get(key))
    if number is None or number != int(number) or not 0 < number <= LARGEST_SIDE_PX:
        raise InputError(path, f"{key} in its metadata is not a size in pixels", _REMEDY)
    return int(number)


def _times(path: Path, values: dict[str, Any], numbers: list[int]) -> tuple[list[float], bool]:
    """Return each image's time in s and True; or, if times are unknown, each image's number and False. The times are
    read from the metadata or computed from the frame rate.
    """
    stamps = values.get("frameTimestamps")
    if isinstance(stamps, list) and stamps and numbers[-1] < len(stamps):
        times = finite_list(stamps, len(stamps))
        if times is None:
            raise InputError(path, "frameTimestamps in its metadata are not all numbers", _REMEDY)
        return [times[number] for number in numbers], True
    fps = finite(values.get("fps"))
    if fps is not None and 0 < fps <= FASTEST_HZ:
        return [number / fps for number in numbers], True
    return [float(number) for number in numbers], False


def _positions(values: dict[str, Any]) -> np.ndarray:
    """Return the positions (n, 3) of the device in metres: each stored pose is a quaternion and a translation."""
    poses = values.get("poses")
    rows = [finite_list(pose, 7) for pose in poses] if isinstance(poses, list) else []
    return np.array([row[4:] for row in rows if row is not None]).reshape(-1, 3)


def _decode(archive: zipfile.ZipFile, name: str, camera: SourceCamera) -> tuple[np.ndarray | None, str]:
    import lzfse

    wanted = 4 * camera.width * camera.height
    try:
        # packed data can be some bytes larger than the image
        data = lzfse.decompress(_read(archive, name, wanted + 4096))
    except (lzfse.error, *_DAMAGE) as error:
        # EINVAL means that the zip file is damaged and states a negative position
        if isinstance(error, OSError) and error.errno != errno.EINVAL:
            raise
        return None, "is damaged inside"
    if len(data) != wanted:
        return None, f"holds {len(data)} bytes, an image has {wanted}"
    return to_grey(np.frombuffer(data, "<f4").reshape(camera.height, camera.width)), ""


READERS: Final = (Reader(_is_stray, _open_stray), Reader(_is_record3d, _open_record3d))
