"""When each depth image was taken: timestamps.csv, or a frame rate where the recorder kept no times.

Some recorders write an image twice under two times: the second copy shows an earlier moment than its time states.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from anchorpose.errors import InputError
from anchorpose.recording.document import read_text
from anchorpose.recording.regular_file import Unreadable, read_bounded

MOST_REPEATED: Final = 0.1
"""Share of the times of a camera that may equal the one before; with more, its clock is too coarse."""

SHORTEST_STEP_S: Final = 1e-4
"""No camera takes two depth images so soon after each other: times that differ by less are one time, rounded."""

LONGEST_STEP_S: Final = 5.0
"""Half of the images may not be farther apart: nobody is followed over that, and the unit of the times is another."""

FARTHEST_TIME_S: Final = 1e11
"""From an epoch to today, in seconds, it is a fifth of that at most."""

Seconds = Annotated[float, Field(ge=-FARTHEST_TIME_S, le=FARTHEST_TIME_S, description="a time in seconds")]

_UNITS: Final = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
_USUAL_STEP_S: Final = 1.0 / 30.0


def read_timestamps(path: Path) -> dict[int, float]:
    """Return frame number to time in seconds, in the order of the file.

    Recorders sometimes stamp a frame with the time of the one before; such a time is kept, and the caller leaves its
    depth image out. Raises InputError where frame numbers do not increase, where time goes back, and where so many
    times repeat that the clock is too coarse.
    """
    times: dict[int, float] = {}
    last_frame, last_time = -1, -math.inf
    repeated = list[str]()
    for line, cells in _rows(path):
        frame, time_s = _parse_row(path, line, cells)
        if frame <= last_frame:
            raise InputError(path, f"line {line}: frame {frame} does not come after {last_frame}", "sort the rows")
        later = "later" if time_s <= last_time else f"{1e3 * SHORTEST_STEP_S:g} ms later"
        problem = f"line {line}: time {time_s:.15g} s of frame {frame} is not {later} than {last_time:.15g} s"
        if time_s < last_time:
            raise InputError(
                path, problem, "times must increase: sort the rows, or correct the clock that was set back"
            )
        if time_s - last_time <= SHORTEST_STEP_S:
            repeated.append(problem)
        times[frame] = time_s
        last_frame, last_time = frame, time_s
    if not times:
        raise InputError(path, "lists no frame", "add one row per depth image or remove the recording")
    if len(repeated) > MOST_REPEATED * len(times):
        remedy = "write times with more decimals, or remove the depth images that were stored twice"
        raise InputError(path, f"{repeated[0]}, and so for {len(repeated)} of {len(times)} frames", remedy)
    require_seconds(path, np.array(list(times.values())))
    return times


def require_seconds(path: Path, time_s: np.ndarray) -> None:
    """Raises InputError where the times (n,) can only be of another unit, or of none."""
    with np.errstate(over="ignore"):
        step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    if step > LONGEST_STEP_S:
        problem = f"has times that are {step:.6g} s apart"
        unit = min(_UNITS, key=lambda name: abs(np.log(step / _UNITS[name] / _USUAL_STEP_S)))
        if SHORTEST_STEP_S < step / _UNITS[unit] <= LONGEST_STEP_S:
            problem += f", as if they were {unit}"
            raise InputError(path, problem, f"write seconds: divide the times by {_UNITS[unit]:,.0f}")
        raise InputError(path, problem, "write when each image was taken, in seconds")
    if np.abs(time_s).max() > FARTHEST_TIME_S:
        problem = f"has the time {time_s[np.abs(time_s).argmax()]:.6g} s"
        raise InputError(path, problem, "write seconds, from the start of the recording or since 1970")


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    lines = read_text(path).splitlines()
    if not lines or [cell.strip() for cell in lines[0].split(",")] != ["frame", "time_s"]:
        raise InputError(path, f"starts with {lines[0][:60] if lines else ''!r}", "its first line must be frame,time_s")
    for number, line in enumerate(lines[1:], start=2):
        if line.strip():
            yield number, line.split(",")


def _parse_row(path: Path, line: int, cells: list[str]) -> tuple[int, float]:
    try:
        frame, time_s = int(cells[0]), float(cells[1])
        if len(cells) == 2 and frame >= 0 and math.isfinite(time_s):
            return frame, time_s
    except (ValueError, IndexError):
        pass
    problem = f"line {line} is {','.join(cells)[:60]!r}, not a frame number and a time"
    raise InputError(path, problem, "write for example 12,0.400")


MOST_DUPLICATES: Final = 0.5
"""Share of images that may equal the one before; with more, the images have no noise and equality means nothing."""


def find_duplicates(files: Sequence[Path], sizes: Sequence[int], most_bytes: int) -> np.ndarray:
    """Return (n,) bool: which files, regular ones of so many bytes, are equal, byte for byte, to the file before.

    The noise of a depth sensor makes two images of the same scene differ, so equal files are one image. Files of
    different sizes are not opened, nor are those above ``most_bytes``, which no depth image has. All False where most
    files are equal: such images have no noise.
    """
    duplicate = np.zeros(len(files), dtype=bool)
    for k in range(1, len(files)):
        duplicate[k] = 0 < sizes[k] == sizes[k - 1] <= most_bytes and _same(files[k - 1], files[k], sizes[k])
    return duplicate if duplicate.sum() <= MOST_DUPLICATES * len(files) else np.zeros(len(files), dtype=bool)


def _same(one: Path, other: Path, size: int) -> bool:
    try:
        return read_bounded(one, size) == read_bounded(other, size)
    except Unreadable:
        return False  # reported when the file is read
