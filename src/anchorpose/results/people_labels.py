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
from anchorpose.results.parquet import (
    TRACK_AGAIN,
    RecordTable,
    read_any_parquet,
    read_parquet_schema,
    require_columns,
    required,
)

FRAMES_KEPT: Final = 64  # read last, of all cameras: under a megabyte

ROOM: Final = 0
"""Neither equipment nor a person: the room, small components, and pixels without a reading."""

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
        raise InputError(path, "has two pictures of one frame and camera", TRACK_AGAIN)
    return images


def frames_of_people(path: Path) -> np.ndarray:
    """(k,) int32, increasing: the frames of which there is an image, without reading the images."""
    frames: np.ndarray = np.unique(read_any_parquet(path, columns=["frame"])["frame"].to_numpy())
    return frames


class StoredPeople:
    """The images of a people.parquet, read when they are needed: those of an hour would fill the memory.

    Raises InputError where the file is not such a table; threads may share it.
    """

    def __init__(self, path: Path) -> None:
        require_columns(path, read_parquet_schema(path), PEOPLE.schema)
        self._read = lru_cache(FRAMES_KEPT)(lambda frame: read_people(path, [frame]))

    def get(self, frame: int, camera: str) -> LabelImage | None:
        """Return the image, still encoded; None where there is none. Raises InputError where it cannot be read."""
        return self._read(frame).get((frame, camera))
