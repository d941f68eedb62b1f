"""people.parquet: the person label of each pixel, one small image per camera and frame, for viewers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from anchorpose.errors import InputError
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.results.parquet import TRACK_AGAIN, RecordTable, opened_parquet, read_any_parquet, required

GROUPS_KEPT: Final = 4
"""Row groups read last that stay in memory: some seconds of three cameras, a few megabytes."""

ROOM: Final = 0
"""Neither equipment nor a person: the room, small components, and pixels without a reading."""

_NOWHERE: Final = np.empty(0, np.int32)

_PNG_SETTINGS: Final = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE)
"""Large areas have one value: run lengths make the smallest files, 5 kB an image."""


@dataclass(frozen=True, slots=True)
class LabelImage:
    """One camera's segmentation; labels: an 8-bit PNG of ``PixelLabel``, ``ROOM`` where there is no person."""

    frame: int
    camera: str
    labels: bytes


PEOPLE: Final = RecordTable(
    file="people.parquet",
    record=LabelImage,
    schema=pa.schema(required(frame=pa.int32(), camera=pa.string(), labels=pa.binary())),
    rows_per_group=256,  # about half a megabyte
    remedy=TRACK_AGAIN,
)
PEOPLE_FILE, write_people = PEOPLE.file, PEOPLE.open


def encode_labels(frame: int, camera: str, view: View) -> LabelImage:
    """The segmentation of one camera's view."""
    labelled = (view.labels >= PixelLabel.PATIENT) | (view.labels == PixelLabel.EQUIPMENT)
    labels = np.where(labelled, view.labels, np.uint8(ROOM))
    _, encoded = cv2.imencode(".png", labels, _PNG_SETTINGS)
    return LabelImage(frame, camera, encoded.tobytes())


def decode_labels(image: LabelImage) -> np.ndarray:
    """(height, width) uint8 labels. Raises ValueError where the bytes are not an 8-bit image."""
    labels = cv2.imdecode(np.frombuffer(image.labels, np.uint8), cv2.IMREAD_UNCHANGED)
    if labels is None or labels.dtype != np.uint8 or labels.ndim != 2:
        raise ValueError(f"frame {image.frame}, camera {image.camera}: the labels are not an 8-bit image")
    return labels


def read_people(path: Path, frames: Sequence[int] | None = None) -> dict[tuple[int, str], LabelImage]:
    """The images of some frames, or of all, still encoded, by frame and camera; raises InputError for two of one."""
    rows = PEOPLE.read(path, None if frames is None else pc.field("frame").isin(frames))
    images = {(row.frame, row.camera): row for row in rows}
    if len(images) != len(rows):
        raise _two_of_one(path)
    return images


def frames_of_people(path: Path) -> np.ndarray:
    """(k,) int32, increasing: the frames of which there is an image, without reading the images."""
    frames: np.ndarray = np.unique(read_any_parquet(path, columns=["frame"])["frame"].to_numpy())
    return frames


class StoredPeople:
    """The images of a people.parquet, read when they are needed: those of an hour would fill the memory.

    Raises InputError where the file is not such a table, or has two images of one camera and frame; threads may share
    it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        keys, group = self._read_keys()
        if keys.group_by(["frame", "camera"]).aggregate([]).num_rows != len(keys):
            raise _two_of_one(path)
        frame, camera = keys["frame"].to_numpy(), keys["camera"].to_numpy(zero_copy_only=False)
        self._where = dict[str, tuple[np.ndarray, np.ndarray]]()
        for name in np.unique(camera):
            order = np.flatnonzero(camera == name)
            order = order[np.argsort(frame[order])]
            self._where[str(name)] = (frame[order], group[order])
        self._read = lru_cache(GROUPS_KEPT)(self._read_group)

    def get(self, frame: int, camera: str) -> LabelImage | None:
        """The image, still encoded; None where there is none. Raises InputError where it cannot be read."""
        frames, groups = self._where.get(camera, (_NOWHERE, _NOWHERE))
        place = int(np.searchsorted(frames, frame))
        if place == len(frames) or frames[place] != frame:
            return None
        found = self._read(int(groups[place])).get((frame, camera))
        if found is None:
            raise InputError(self._path, "has been replaced meanwhile", "start again")
        return found

    def _read_keys(self) -> tuple[pa.Table, np.ndarray]:
        """Frame and camera of each row, and (n,) int32 the row group that it is in."""
        with opened_parquet(self._path, PEOPLE.schema) as file:
            rows = [file.metadata.row_group(number).num_rows for number in range(file.num_row_groups)]
            return file.read(["frame", "camera"]), np.repeat(np.arange(len(rows), dtype=np.int32), rows)

    def _read_group(self, number: int) -> dict[tuple[int, str], LabelImage]:
        with opened_parquet(self._path, PEOPLE.schema) as file:
            rows = PEOPLE.records(self._path, file.read_row_group(number)) if number < file.num_row_groups else ()
        return {(row.frame, row.camera): row for row in rows}


def _two_of_one(path: Path) -> InputError:
    return InputError(path, "has two pictures of one frame and camera", TRACK_AGAIN)
