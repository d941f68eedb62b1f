"""Raw dumps of 16-bit grey values, one file for all images or a folder with one each, with a sidecar that describes
them (``image_folder``)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.document import LARGEST_BYTES, parse_json
from anchorpose.recording.regular_file import Unreadable, open_regular, read_bounded
from anchorpose.sources.grey_images import ImageFiles, natural_order
from anchorpose.sources.image_folder import SIDECAR, SidecarDocument, camera_of, file_times, frame_files, times_of
from anchorpose.sources.source import NO_READING, Source, SourceCamera, SourceFrame


def matches(path: Path, head: bytes) -> bool:
    """Whether a sidecar that gives a size describes this file or folder."""
    sidecar = _sidecar(path)
    if sidecar == path:
        return False
    try:
        values = parse_json(read_bounded(sidecar, LARGEST_BYTES))
    except (Unreadable, ValueError):
        return False
    return isinstance(values, dict) and values.get("format") == "depth-sidecar" and (path.is_file() or _is_raw(path))


def open_source(path: Path) -> Source:
    """Raises InputError where the sidecar does not fit."""
    sidecar = _sidecar(path)
    given = SidecarDocument.read(sidecar)
    if given.width is None or given.height is None:
        raise InputError(sidecar, "has no width and height", "add both: raw images do not tell their size")
    name = path.resolve().stem if path.is_file() else path.resolve().name
    camera = camera_of(
        given,
        SourceCamera(name=name, width=given.width, height=given.height, depth_scale=None, has_times=False),
        sidecar,
    )
    order = ">u2" if given.byte_order == "big" else "<u2"
    if path.is_file():
        return RawFile(path, camera, order, given)
    files, _ = frame_files(sorted(_raw_files(path), key=natural_order))
    files = file_times(given, sidecar, files) or files
    return ImageFiles(path, camera, files, read=lambda file, shape: _read_raw(file, shape, order))


class RawFile:
    """All depth images of one camera, one after another in one file."""

    def __init__(self, path: Path, camera: SourceCamera, order: str, given: SidecarDocument) -> None:
        self._bytes = 2 * camera.width * camera.height
        self._count, self._rest = divmod(path.stat().st_size, self._bytes)
        if self._count == 0:
            problem = f"is shorter than one image of {camera.width} x {camera.height} pixels"
            raise InputError(path, problem, "check width and height in its sidecar")
        times = times_of(given, _sidecar(path), np.arange(self._count, dtype=float))
        self._times = np.arange(self._count, dtype=float) if times is None else times
        self.path, self._order = path, order
        self.cameras: tuple[SourceCamera, ...] = (camera,)

    @property
    def notes(self) -> tuple[str, ...]:
        """Whether the last image is incomplete."""
        if not self._rest:
            return ()
        return (
            f"{self.path.name} ends within an image, which was left out; its sidecar's width and height may be wrong.",
        )

    def frames(self, skip: Sequence[int]) -> Iterator[SourceFrame]:
        """The depth images in the order of the file."""
        camera = self.cameras[0]
        with open_regular(self.path) as file:
            file.seek(skip[0] * self._bytes)
            for position in range(skip[0], self._count):
                data = file.read(self._bytes)
                if len(data) < self._bytes:
                    raise InputError(self.path, "became shorter while it was read", "convert it once it is complete")
                grey = np.frombuffer(data, self._order).reshape(camera.height, camera.width).astype(np.uint16)
                grey[grey == NO_READING] = 0
                yield SourceFrame(0, float(self._times[position]), grey)


def _read_raw(path: Path, camera: SourceCamera, order: str) -> tuple[np.ndarray | None, str]:
    wanted, size = 2 * camera.width * camera.height, path.stat().st_size
    if size != wanted:
        return None, f"has {size} bytes, an image of this size has {wanted}"
    with open_regular(path) as file:
        data = file.read(wanted)
    return np.frombuffer(data, order).reshape(camera.height, camera.width).astype(np.uint16), ""


def _sidecar(path: Path) -> Path:
    return path / SIDECAR if path.is_dir() else path.with_suffix(".json")


def _raw_files(folder: Path) -> list[Path]:
    return [file for file in folder.iterdir() if file.suffix.lower() in {".raw", ".bin"} and file.name[0] != "."]


def _is_raw(path: Path) -> bool:
    return path.is_dir() and bool(_raw_files(path))
