"""people.parquet: whose each pixel is, a small picture a camera and frame, so that a viewer need not track again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from anchorpose.errors import InputError
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.results.tables import RowGroups, open_parquet, read_parquet

PEOPLE_FILE: Final = "people.parquet"

PEOPLE_SCHEMA: Final = pa.schema(
    [
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("camera", pa.string(), nullable=False),
        pa.field("labels", pa.binary(), nullable=False),
    ]
)

PICTURES_PER_ROW_GROUP: Final = 256
"""About half a megabyte; fixed, since row groups decide the bytes of the file."""

ROOM: Final = 0
"""What is neither equipment nor somebody: the room, crumbs, and pixels without a reading, which the depth tells."""

_PACKED: Final = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE)
"""Areas of one value: run lengths make the smallest files, 5 kB a picture."""


@dataclass(frozen=True, slots=True)
class LabelPicture:
    """One camera's pixels told apart, as an 8-bit PNG of ``PixelLabel``, ``ROOM`` for all that is nobody's."""

    frame: int
    camera: str
    png_bytes: bytes


def label_picture(frame: int, camera: str, view: View) -> LabelPicture:
    """The picture of one camera's view."""
    somebody = (view.labels >= PixelLabel.PATIENT) | (view.labels == PixelLabel.EQUIPMENT)
    known = np.where(somebody, view.labels, np.uint8(ROOM))
    _, encoded = cv2.imencode(".png", known, _PACKED)
    return LabelPicture(frame, camera, encoded.tobytes())


def read_picture(picture: LabelPicture) -> np.ndarray:
    """(height, width) uint8 labels. Raises ValueError where the bytes are no picture."""
    labels = cv2.imdecode(np.frombuffer(picture.png_bytes, np.uint8), cv2.IMREAD_UNCHANGED)
    if labels is None or labels.dtype != np.uint8 or labels.ndim != 2:
        raise ValueError(f"frame {picture.frame}, camera {picture.camera}: the labels are no 8-bit picture")
    return labels


@contextmanager
def write_people(path: Path) -> Iterator[RowGroups[LabelPicture]]:
    """Opens people.parquet for writing, frames in any order; where nothing was told apart there is no row."""
    with open_parquet(path, PEOPLE_SCHEMA) as writer:
        pictures = RowGroups(writer, _to_table, PICTURES_PER_ROW_GROUP)
        yield pictures
        pictures.flush()


def read_people(path: Path, frames: Sequence[int] | None = None) -> dict[tuple[int, str], LabelPicture]:
    """The pictures of some frames, or of all, still packed, by frame and camera; raises InputError where one stands
    twice."""
    rows = read_parquet(path, PEOPLE_SCHEMA, None if frames is None else pc.field("frame").isin(frames)).to_pylist()
    pictures = {(row["frame"], row["camera"]): LabelPicture(row["frame"], row["camera"], row["labels"]) for row in rows}
    if len(pictures) != len(rows):
        raise InputError(path, "has two pictures of one frame and camera", "track the recording again")
    return pictures


def frames_of_people(path: Path) -> np.ndarray:
    """(k,) int32, increasing: the frames of which there is a picture, without reading the pictures."""
    frames: np.ndarray = np.unique(pq.read_table(path, columns=["frame"])["frame"].to_numpy())
    return frames


def _to_table(pictures: Sequence[LabelPicture]) -> pa.Table:
    columns = [
        pa.array([picture.frame for picture in pictures], pa.int32()),
        pa.array([picture.camera for picture in pictures], pa.string()),
        pa.array([picture.png_bytes for picture in pictures], pa.binary()),
    ]
    return pa.Table.from_arrays(columns, schema=PEOPLE_SCHEMA)
