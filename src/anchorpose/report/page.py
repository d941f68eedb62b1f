"""report.html: one page that a clinician opens anywhere, made from the tables, run.json and the kept pictures."""

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
from anchorpose.report.measure_section import measure_section
from anchorpose.report.motion_section import angle_section, joint_charts, state_table
from anchorpose.report.provenance import corrections, problems, provenance, settings
from anchorpose.report.session import Session, read_session
from anchorpose.report.summary import moment_section, summary
from anchorpose.report.timeline import timeline
from anchorpose.report.words import STATE_WORDS, counted
from anchorpose.results.folder import write_text_whole
from anchorpose.results.web_page import render_page

REPORT_FILE: Final = "report.html"

WEBP_QUALITY: Final = 80
"""Lines and names stay sharp at a quarter of the bytes of PNG; the PNG pictures are in the results folder."""


def write_report(results: Path) -> Path:
    """Writes report.html into a results folder and returns its path; the same folder gives the same bytes.

    Raises InputError where a table or run.json is missing or cannot be used; nothing is written then.
    """
    session = read_session(results)
    write_text_whole(results / REPORT_FILE, _page(session))
    return results / REPORT_FILE


def _page(session: Session) -> str:
    return render_page(
        "anchorpose.report",
        "templates/page.html",
        title=f"Stand training: {session.recording}",
        state_titles=["joint", *(f"{words}, %" for words in STATE_WORDS.values()), "typical ±, mm"],
        thinned=_thinned(session),
        pictures=kept_frames(session),
        problems=problems(session),
        notes=[str(note) for note in session.run.get("notes", [])],
        corrections=corrections(session),
        provenance=provenance(session),
        settings=settings(session),
        summary=summary(session),
        timeline=timeline(session),
        moments=moment_section(session),
        measures=measure_section(session),
        angles=angle_section(session),
        states=state_table(session),
        joints=joint_charts(session),
    )


def _thinned(session: Session) -> str:
    if not session.bins.thinned:
        return "Every frame is drawn."
    frames, groups = counted(len(session.joints.frame), "frame"), counted(session.bins.count, "group")
    return (
        f"The {frames} are drawn in {groups} of neighbours, each from its lowest to its highest value, so that peaks "
        "stay (a line runs in the middle, a darker band from one to the other); all frames are in the tables."
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A picture for the page. size: (width, height) in pixels; data: WebP in base64, empty where it is damaged."""

    caption: str
    size: tuple[int, int]
    data: str


class KeptFrame(NamedTuple):
    """A frame with pictures: why it was chosen, how many joints were seen in it, and each camera's picture."""

    frame: int
    title: str
    seen: str
    figures: list[Figure]


def kept_frames(session: Session) -> list[KeptFrame]:
    """The frames with pictures in the results folder, in the order of run.json."""
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
    """Decoded and encoded again, so that no other content of a file gets into the page."""
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
