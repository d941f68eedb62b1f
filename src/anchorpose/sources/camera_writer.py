"""One camera's folder while it is converted: images, then their rows, so that what has a row is complete."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from types import TracebackType
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.depth_image import decode_grey_png
from anchorpose.recording.regular_file import LARGEST_IMAGE, LARGEST_TABLE, read_whole
from anchorpose.recording.timestamps import MOST_REPEATED, read_timestamps
from anchorpose.sources.plan import CameraPlan

_HEADER: Final = "frame,time_s"
BEGIN_AGAIN: Final = "remove the unfinished recording and begin again"


class CameraWriter:
    """Goes on where an earlier run was stopped. An image's number is its place among those that the source gave."""

    def __init__(self, folder: Path, plan: CameraPlan) -> None:
        self.folder, self._plan = folder, plan
        (folder / "depth").mkdir(parents=True, exist_ok=True)
        rows = _complete_rows(folder, plan)
        self.given = rows[-1][0] + 1 if rows else 0
        self.written = len(rows)
        self._last = rows[-1][1] if rows else ""
        self._rows = (folder / "timestamps.csv").open("w", encoding="utf-8")
        self._rows.write("".join(f"{line}\n" for line in (_HEADER, *(f"{k},{time}" for k, time in rows))))
        self._rows.flush()

    def __enter__(self) -> CameraWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._rows.close()

    def write(self, time_s: float, grey: np.ndarray, number: int | None = None) -> Path | None:
        """Writes an image and returns its file; None where it is not later than the one before and is left out.

        time_s as in ``SourceFrame``; number: larger than the last one, where the source knows of images that it lost.
        """
        number = self.given if number is None else number
        self.given = number + 1
        stamp = f"{time_s if self._plan.fps is None else time_s / self._plan.fps:.6f}"
        if not math.isfinite(float(stamp)) or (self._last and float(stamp) <= float(self._last)):
            return None
        path = self.folder / "depth" / f"{number:06d}.png"
        path.write_bytes(encode_grey(grey))
        self._rows.write(f"{number},{stamp}\n")
        self._rows.flush()
        self._last, self.written = stamp, self.written + 1
        return path

    def note(self, source: Path) -> str:
        """Return how many images were left out for their times; empty for none. Raises InputError, naming ``source``,
        where these are too many, or where those that are left cannot be seconds."""
        if self.written:
            self._require_times(source)
        left_out = self.given - self.written
        if left_out == 0:
            return ""
        sentence = f"{left_out} of {self.given} times are not later than the one before"
        if left_out > MOST_REPEATED * self.given:
            remedy = "the device's clock was set back or is too coarse: record again"
            raise InputError(source, sentence, remedy)
        return f"{self.folder.name}: {sentence}; their images were left out."

    def _require_times(self, source: Path) -> None:
        try:
            read_timestamps(self.folder / "timestamps.csv")
        except InputError as error:
            remedy = "the file is damaged, or its clock has another unit: record or export it again"
            raise InputError(source, f"the clock of {self.folder.name} {error.problem}", remedy) from None


def encode_grey(grey: np.ndarray) -> bytes:
    """Return a PNG file of grey values (height, width) uint16.

    Run lengths beside Huffman coding: noise has no longer repetitions, and looking for them doubles the time.
    """
    import cv2

    how = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE)
    encoded = cv2.imencode(".png", grey, (*how, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP))[1]
    return bytes(encoded.tobytes())


def _complete_rows(folder: Path, plan: CameraPlan) -> list[tuple[int, str]]:
    """Return number and time of the images that are there whole: all exist, and the last one can be decoded."""
    path = folder / "timestamps.csv"
    if not path.is_file():
        return []
    text = read_whole(path, LARGEST_TABLE, BEGIN_AGAIN).decode("utf-8", errors="replace")
    lines = text.split("\n")[1:-1]  # a last one without its end is cut off
    there = {file.name for file in (folder / "depth").iterdir()}
    rows = list[tuple[int, str]]()
    for line in lines:
        number, _, time = line.partition(",")
        if not (number.isdecimal() and _is_time(time)) or f"{int(number):06d}.png" not in there:
            break
        rows.append((int(number), time))
    while rows and not _is_whole(folder / "depth" / f"{rows[-1][0]:06d}.png", plan):
        rows.pop()
    return rows


def _is_time(text: str) -> bool:
    with contextlib.suppress(ValueError):
        return math.isfinite(float(text))
    return False


def _is_whole(path: Path, plan: CameraPlan) -> bool:
    return (
        decode_grey_png(read_whole(path, LARGEST_IMAGE, BEGIN_AGAIN), plan.camera.width, plan.camera.height)[0]
        is not None
    )
