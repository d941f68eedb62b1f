"""Formats that only their vendor's software reads: each is refused with the way round."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

from anchorpose.errors import InputError
from anchorpose.recording.regular_file import open_regular


def matches(path: Path, head: bytes) -> bool:
    """Whether this is one of them."""
    return _format(path, head) is not None


def open_source(path: Path) -> NoReturn:
    """Raises InputError with the way round."""
    with open_regular(path) as file:
        found = _format(path, file.read(4096))
    what, remedy = found or ("is not readable", "export its depth images as 16-bit PNG")
    raise InputError(path, what, remedy)


def _format(path: Path, head: bytes) -> tuple[str, str] | None:
    """What the file is and what to do instead."""
    if head.startswith(b"EVENTS1\0"):
        return (
            "is a Kinect Studio recording (.xef), which holds depth only for Microsoft's software",
            "play it in Kinect Studio while another program saves the depth images as 16-bit PNG, and convert their "
            "folder",
        )
    if head.startswith(b"NI10"):
        return (
            "is an OpenNI recording (.oni), which only OpenNI unpacks",
            "export its depth images as 16-bit PNG with OpenNI's NiViewer or a few lines of OpenNI's Python package, "
            "and convert their folder",
        )
    if _is_zed(path, head):
        return (
            "is a ZED recording (.svo), which holds two colour videos and no depth",
            "export depth as 16-bit PNG with Stereolabs' ZED SDK (its SVO export sample), and convert their folder",
        )
    return None


def _is_zed(path: Path, head: bytes) -> bool:
    """An .svo2 is an MCAP file that names its writer; the older .svo has no published mark, so its name decides."""
    if head.startswith(b"\x89MCAP0\r\n"):
        return b"stereolabs" in head[:256]
    return path.is_file() and path.suffix.lower() in {".svo", ".svo2"}
