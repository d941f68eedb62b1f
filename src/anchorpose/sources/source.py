"""What every reader of a recorder's files gives: the cameras in them, and their depth images one by one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from anchorpose.lens import Intrinsics

NO_READING: Final = 65535  # beside 0; what sensors give for "too far" or "too near"

STANDS_STILL_M: Final = 0.03  # a phone on a tripod; its own estimate of where it is wanders by some millimetres


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceCamera:
    """One depth camera of a recorder's file, as far as the file tells.

    name: for a folder; depth_scale: metres per grey value, None where the file does not tell; intrinsics: None where
    the file has no lens; T_world_camera: (4, 4) where the file places the camera; model and serial: empty where not
    known; count: of its depth images, None where only reading all of the file tells; has_times: False where the file
    only numbers its images.
    """

    name: str
    width: int
    height: int
    depth_scale: float | None
    intrinsics: Intrinsics | None = None
    T_world_camera: np.ndarray | None = None
    model: str = ""
    serial: str = ""
    count: int | None = None
    has_times: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class SourceFrame:
    """One depth image: time_s by the device's own clock, to the microsecond, or, where the camera has no times, the
    image's number; depth (height, width) uint16, grey values as the file has them, 0 = no reading (65535 and NaN are 0
    already), native byte order."""

    camera: int
    time_s: float
    depth: np.ndarray


class Source(Protocol):
    """A recorder's file or folder that was opened: its header has been read and checked.

    notes: sentences on what was decided (units, what is missing, frames that are damaged once all are read).
    """

    path: Path
    cameras: tuple[SourceCamera, ...]

    def frames(self, skip: Sequence[int]) -> Iterator[SourceFrame]:
        """The depth images in the order of the file, streamed; skip: how many of each camera were taken before.

        A damaged image is left out with a note; raises InputError where the rest of the file cannot be read.
        """
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for the user, complete once all frames were read."""
        ...


class Reader(Protocol):
    """A module that reads one format. ``matches`` looks at the content, not at the ending."""

    def matches(self, path: Path, head: bytes) -> bool:
        """Whether a path is of this format; head: the first 4096 bytes of a file, empty for a folder."""
        ...

    def open_source(self, path: Path) -> Source:
        """Raises InputError where the header cannot be used, or an extra is not installed."""
        ...


def damaged_notes(left_out: Mapping[str, str]) -> tuple[str, ...]:
    """A sentence on depth images that were left out, by name and what is wrong with each; none where none was."""
    if not left_out:
        return ()
    first, problem = next(iter(left_out.items()))
    return (f"Damaged depth images that were left out: {len(left_out)}; the first, {first}, {problem}.",)


def movement_note(positions_m: np.ndarray) -> tuple[str, ...]:
    """A sentence where a camera at ``positions_m`` (n, 3) was moved; NaN rows are unknown."""
    known = positions_m[np.isfinite(positions_m).all(axis=1)]
    if len(known) == 0:
        return ()
    moved_m = float(np.linalg.norm(known - np.median(known, axis=0), axis=1).max())
    if moved_m <= STANDS_STILL_M:
        return ()
    return (f"The camera was moved by {moved_m:.2f} m while it recorded: tracking needs one that stands still.",)
