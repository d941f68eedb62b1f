"""people.parquet: whose each pixel is, a small picture a camera and frame, so that a viewer need not track again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Final

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

GROUPS_KEPT: Final = 4
"""Of those read last: some seconds of three cameras around where somebody looks, a few megabytes."""

_NOWHERE: Final = np.empty(0, np.int32)

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


class StoredPeople:
    """The pictures of a people.parquet, read where they are asked for: those of an hour would fill the memory.

    Raises InputError where it is none, or one picture stands twice; threads may share it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        keys, group = _read_keys(path)
        if keys.group_by(["frame", "camera"]).aggregate([]).num_rows != len(keys):
            raise InputError(path, "has two pictures of one frame and camera", "track the recording again")
        frame, camera = keys["frame"].to_numpy(), keys["camera"].to_numpy(zero_copy_only=False)
        self._where = dict[str, tuple[np.ndarray, np.ndarray]]()
        for name in np.unique(camera):
            order = np.flatnonzero(camera == name)
            order = order[np.argsort(frame[order])]
            self._where[str(name)] = (frame[order], group[order])
        self._read = lru_cache(GROUPS_KEPT)(partial(_read_group, path))

    def get(self, frame: int, camera: str) -> LabelPicture | None:
        """The picture, still packed; None where nothing was told apart. Raises InputError where it cannot be read."""
        frames, groups = self._where.get(camera, (_NOWHERE, _NOWHERE))
        place = int(np.searchsorted(frames, frame))
        if place == len(frames) or frames[place] != frame:
            return None
        found = self._read(int(groups[place])).get((frame, camera))
        if found is None:
            raise InputError(self._path, "has been replaced meanwhile", "start again")
        return found


def _read_keys(path: Path) -> tuple[pa.Table, np.ndarray]:
    """Frame and camera of each row, and (n,) int32 the row group that it is in."""
    with _opened(path) as file:
        rows = [file.metadata.row_group(number).num_rows for number in range(file.num_row_groups)]
        return file.read(["frame", "camera"]), np.repeat(np.arange(len(rows), dtype=np.int32), rows)


def _read_group(path: Path, number: int) -> dict[tuple[int, str], LabelPicture]:
    with _opened(path) as file:
        rows = file.read_row_group(number).to_pylist() if number < file.num_row_groups else []
    return {(row["frame"], row["camera"]): LabelPicture(row["frame"], row["camera"], row["labels"]) for row in rows}


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A parquet file of our columns; raises InputError where it is none or cannot be read in the block."""
    try:
        with pq.ParquetFile(path) as file:
            if file.schema_arrow.names != PEOPLE_SCHEMA.names or file.schema_arrow.types != PEOPLE_SCHEMA.types:
                raise InputError(path, f"its columns are not {', '.join(PEOPLE_SCHEMA.names)}", "track again")
            yield file
    except (pa.ArrowException, OSError) as error:
        problem = f"is no parquet table ({str(error).splitlines()[0][:80]})"
        raise InputError(path, problem, "track the recording again") from None


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
