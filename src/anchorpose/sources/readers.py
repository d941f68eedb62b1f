"""Finding the reader of a recorder's file or folder, by its content."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Final, cast

from anchorpose.errors import InputError
from anchorpose.recording.regular_file import open_regular
from anchorpose.sources.source import Reader, Source

READERS: Final = (
    "refused",  # before ros_bags: a ZED's .svo2 is an MCAP file
    "azure_kinect",
    "ros_bags",
    "stray_scanner",
    "tum_rgbd",
    "exported_folders",
    "record3d",
    "arrays",
    "raw_dump",
    "image_folder",  # last: most folders above hold a folder of images
)
"""Modules of this package, each a ``Reader``, in the order in which they are asked."""

HEAD_BYTES: Final = 4096


def find_reader(path: Path) -> Reader | None:
    """The reader that knows a file or folder by its content, or None; raises InputError where it cannot be read."""
    if not path.exists():
        raise InputError(path, "there is no such file or folder", "check the path")
    try:
        head = b"" if path.is_dir() else _head(path)
        return next((reader for reader in _readers() if reader.matches(path, head)), None)
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "check the file and its permissions") from None


def open_source(path: Path) -> Source:
    """A recorder's file or folder, opened; raises InputError where no reader knows it or its header cannot be used."""
    if (path / "recording.json").is_file():
        raise InputError(path, "is a recording already", "give it to 'anchorpose track' as it is")
    reader = find_reader(path)
    if reader is None:
        raise InputError(path, "is of no format that can be read", "see docs/guide/convert.md for those that can")
    try:
        return reader.open_source(path)
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "check the file and its permissions") from None


def _readers() -> Iterator[Reader]:
    """Imported one by one: a reader that is not asked costs nothing."""
    for name in READERS:
        yield cast("Reader", import_module(f"anchorpose.sources.{name}"))


def _head(path: Path) -> bytes:
    with open_regular(path) as file:
        return file.read(HEAD_BYTES)
