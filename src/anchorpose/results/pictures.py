"""Pictures of frames, kept beside the tables so that the report can be made again."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from anchorpose.results.run_record import PictureRecord


@dataclass(frozen=True, slots=True)
class FramePicture:
    """One camera's frame, drawn over (see ``draw_frame``)."""

    frame: int
    time_s: float
    camera: str
    png_bytes: bytes
    caption: str
    why: str = ""  # the frame was chosen, for people; empty where it only stands for the others


def save_pictures(folder: Path, pictures: Iterable[FramePicture]) -> tuple[PictureRecord, ...]:
    """Writes the pictures to ``folder``/pictures and returns what run.json says of them."""
    records = []
    for picture in pictures:
        file = f"pictures/{picture.frame:06d}_{picture.camera}.png"
        (folder / "pictures").mkdir(exist_ok=True)
        (folder / file).write_bytes(picture.png_bytes)
        records.append(PictureRecord(file, picture.frame, picture.time_s, picture.camera, picture.caption, picture.why))
    return tuple(records)
