"""The pictures that were kept of a recording, frame by frame, each with how well the patient could be seen then."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from anchorpose.report.session import Session
from anchorpose.report.words import escape
from anchorpose.results.joint_frame import LOST

WEBP_QUALITY: Final = 80
"""Lines and names stay sharp at a quarter of the bytes of PNG; the PNG pictures are in the results folder."""


def frame_pictures(session: Session) -> str:
    """HTML: a heading and the cameras of each frame; the frames with the most and least of the patient are named."""
    by_frame: dict[int, list[dict[str, Any]]] = {}
    for picture in session.run.get("pictures", []):
        if (session.folder / picture["file"]).is_file():
            by_frame.setdefault(picture["frame"], []).append(picture)
    if not by_frame:
        return "<p>No pictures were kept.</p>"
    ranks = _ranks(session, list(by_frame))
    return "".join(
        _frame(session, number, frame, pictures, ranks.get(frame, ""))
        for number, (frame, pictures) in enumerate(by_frame.items(), 1)
    )


def _frame(session: Session, number: int, frame: int, pictures: Sequence[dict[str, Any]], rank: str) -> str:
    title = f"{number}. Frame {frame}, {pictures[0]['time_s']:.2f} s{rank}"
    figures = "".join(_figure(session.folder, picture) for picture in pictures)
    return (
        f"<section class='kept-frame' id='frame-{frame}'><h3>{escape(title)}</h3>"
        f"<p>{escape(_seen_then(session, frame))}</p><div class='pictures'>{figures}</div></section>"
    )


def _figure(folder: Path, picture: dict[str, Any]) -> str:
    caption = escape(f"Camera {picture['camera']}. {picture['caption']}")
    size, data = _webp(folder / picture["file"])
    return (
        f"<figure><img alt='{caption}' {size} loading='lazy' src='data:{data}'>"
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _webp(path: Path) -> tuple[str, str]:
    """Its size, and itself as the rest of a data address; as it stands where it cannot be decoded."""
    png = path.read_bytes()
    pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    if pixels is None:
        return "", f"image/png;base64,{base64.b64encode(png).decode('ascii')}"
    done, webp = cv2.imencode(".webp", pixels, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])
    kind, data = ("webp", webp.tobytes()) if done else ("png", png)
    size = f"width='{pixels.shape[1]}' height='{pixels.shape[0]}'"
    return size, f"image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _ranks(session: Session, frames: Sequence[int]) -> dict[int, str]:
    """Which of the kept frames shows the most and the least of the patient; none where all are alike."""
    known = [frame for frame in frames if frame in session.joints.frame]
    count = {frame: int((_states(session, frame) == 0).sum()) for frame in known}
    if len(set(count.values())) < 2:
        return {}
    best, least = max(known, key=lambda f: count[f]), min(known, key=lambda f: count[f])
    return {best: ": most joints seen of these frames", least: ": fewest joints seen of these frames"}


def _seen_then(session: Session, frame: int) -> str:
    if frame not in session.joints.frame:
        return ""
    states = _states(session, frame)
    seen, lost = int((states == 0).sum()), int((states == LOST).sum())
    return f"{seen} of {len(states)} joints seen, {len(states) - seen - lost} inferred, {lost} lost."


def _states(session: Session, frame: int) -> np.ndarray:
    states: np.ndarray = session.joints.severity[int(np.flatnonzero(session.joints.frame == frame)[0])]
    return states
