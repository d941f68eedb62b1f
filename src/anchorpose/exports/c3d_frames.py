"""The frames of a C3D file, which ezc3d would hold as objects: 23 kB of memory for 1 kB of the file. Its binding also
never frees the arrays that it is given.

The format (www.c3d.org, user guide): blocks of 512 bytes; the header, parameters, and the frames, each the four numbers
of every point and then one of every channel. All as ezc3d writes it: Intel's byte order, single precision.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np

BLOCK: Final = 512
LARGEST_FRAMES: Final = 65535
"""The format counts frames in 16 bits; a longer recording goes into several files."""

_LAST_FRAME_AT: Final = 8
_RESIDUAL: Final = 256.0  # the residual is the upper byte of a point's fourth number; the lower one names cameras
_MISSING: Final = -1.0  # the fourth number of a missing point, whose place is 0


def frame_numbers(places: np.ndarray, residual: np.ndarray, channels: np.ndarray) -> np.ndarray:
    """(n, 4 p + c) float32, the frames of a file.

    places (n, p, 3); residual (n, p): whole numbers from 0 to 255, negative where the point is missing; channels
    (n, c).
    """
    known = residual >= 0
    place = np.where(known[..., None], places, 0.0)
    fourth = np.where(known, _RESIDUAL * residual, _MISSING)
    points = np.concatenate([place, fourth[..., None]], axis=2)
    return np.concatenate([points.reshape(len(points), -1), channels], axis=1).astype("<f4")


def replace_frames(path: Path, frames: Iterable[np.ndarray]) -> None:
    """Writes frames, some (n, 4 p + c) of ``frame_numbers`` after the other, in place of those of the C3D at ``path``.

    Header and parameters then count them. Raises ValueError where they do not have the file's points and channels, or
    are more than it can count.
    """
    with path.open("r+b") as file:
        points, channels, first, _, _, scale, block = struct.unpack_from("<5HfH", file.read(BLOCK), 2)
        file.seek(0)
        head, count = file.read(BLOCK * (block - 1)), 0
        file.truncate()
        for some in frames:
            count += len(some)
            if some.shape[1] != 4 * points + channels or scale >= 0 or count > LARGEST_FRAMES:
                raise ValueError(f"{count} frames of {some.shape[1]} numbers do not fit into {path.name}")
            file.write(some.tobytes())
        file.write(bytes(BLOCK - file.tell() % BLOCK))  # a whole block where the last one is full
        rotations = file.tell() // BLOCK + 1  # there are none; in a large file ezc3d, too, keeps the lower 16 bits
        for place, value in (
            (_LAST_FRAME_AT, first + count - 1),
            (_value_at(head, b"POINT", b"FRAMES"), count),
            (_value_at(head, b"ROTATION", b"DATA_START"), rotations & 0xFFFF),
        ):
            file.seek(place)
            file.write(struct.pack("<H", value))


def _value_at(head: bytes, group: bytes, parameter: bytes) -> int:
    """Where a parameter with one value has it; head: header and parameters.

    A group or parameter: the length of its name (negative where locked), its group (negative for a group itself), name,
    and how far on the next one is; then for a parameter its type, the count of its dimensions (0 here) and its value.
    """
    place, own = BLOCK * (head[0] - 1) + 4, 0
    while head[place]:
        length, number = struct.unpack_from("<bb", head, place)
        step_at = place + 2 + abs(length)
        name = head[place + 2 : step_at]
        if name == group and number < 0:
            own = -number
        if name == parameter and number == own:
            return step_at + 4
        place = step_at + struct.unpack_from("<H", head, step_at)[0]
    raise ValueError(f"there is no {group.decode()}:{parameter.decode()}")
