"""Collect the frames that the report shows as pictures: each camera's picture, and how many joints were seen."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np

from anchorpose.joints import LOST
from anchorpose.recording.regular_file import read_image
from anchorpose.report.session import Session

WEBP_QUALITY: Final = 80
"""Quality of WebP at which lines and names stay sharp, with files a quarter as large as the PNG files in the results
folder.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A picture for the page. size: (width, height) in pixels; data: WebP in base64, empty if the file is damaged."""

    caption: str
    size: tuple[int, int]
    data: str


class KeptFrame(NamedTuple):
    """A frame that is shown as pictures: the reason why it was chosen, the number of joints seen in it, and each
    camera's picture.
    """

    frame: int
    title: str
    seen: str
    figures: list[Figure]


def kept_frames(session: Session) -> list[KeptFrame]:
    """Return the frames with pictures in the results folder, in the order of run.json."""
    by_frame: dict[int, list[dict[str, Any]]] = {}
    for picture in session.run.get("pictures", []):
        if (session.folder / picture["file"]).is_file():
            by_frame.setdefault(picture["frame"], []).append(picture)
    return [_kept_frame(session, frame, pictures) for frame, pictures in by_frame.items()]


def _kept_frame(session: Session, frame: int, pictures: Sequence[dict[str, Any]]) -> KeptFrame:
    why = pictures[0].get("why")
    title = f"Frame {frame}, {pictures[0]['time_s']:.2f} s" + (f": {why}" if why else "")
    figures = [_figure(session.folder, picture) for picture in pictures]
    return KeptFrame(frame, title, _seen_then(session, frame), figures)


def _figure(folder: Path, picture: dict[str, Any]) -> Figure:
    """Decode the picture and encode it again, so that nothing but its pixels gets into the page."""
    caption = f"Camera {picture['camera']}. {picture['caption']}"
    pixels = read_image(folder / picture["file"], cv2.IMREAD_COLOR)
    if pixels is None:
        return Figure(caption=f"{caption} This picture is damaged.", size=(0, 0), data="")
    webp = cv2.imencode(".webp", pixels, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])[1].tobytes()
    size = (pixels.shape[1], pixels.shape[0])
    return Figure(caption=caption, size=size, data=base64.b64encode(webp).decode("ascii"))


def _seen_then(session: Session, frame: int) -> str:
    found = np.flatnonzero(session.joints.frame == frame)
    if not len(found):
        return ""
    states = session.joints.state_code[found[0]]
    seen, lost = int((states == 0).sum()), int((states == LOST).sum())
    return f"{seen} of {len(states)} joints seen, {len(states) - seen - lost} inferred, {lost} lost."
