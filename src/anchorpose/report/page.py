"""report.html: one page that a clinician opens anywhere, made from the tables, run.json and the kept pictures.

The pictures that were kept of a recording, frame by frame, each with how well the patient could be seen then.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from markupsafe import Markup

from anchorpose.joints import LOST
from anchorpose.report.angle_section import angle_section
from anchorpose.report.measure_section import measure_section
from anchorpose.report.sections import exclusions, joint_section, provenance, state_table
from anchorpose.report.session import Session, read_session
from anchorpose.report.summary import summary
from anchorpose.report.timeline import timeline
from anchorpose.report.words import counted, escape
from anchorpose.results.folder import write_text_whole
from anchorpose.results.web_page import render_page

WEBP_QUALITY: Final = 80
"""Lines and names stay sharp at a quarter of the bytes of PNG; the PNG pictures are in the results folder."""


def frame_pictures(session: Session) -> str:
    """HTML: a heading, why the frame was chosen, and its cameras, for each frame."""
    by_frame: dict[int, list[dict[str, Any]]] = {}
    for picture in session.run.get("pictures", []):
        if (session.folder / picture["file"]).is_file():
            by_frame.setdefault(picture["frame"], []).append(picture)
    if not by_frame:
        return "<p>No pictures were kept.</p>"
    return "".join(
        _frame(session, number, frame, pictures) for number, (frame, pictures) in enumerate(by_frame.items(), 1)
    )


def _frame(session: Session, number: int, frame: int, pictures: Sequence[dict[str, Any]]) -> str:
    why = pictures[0].get("why")
    title = f"{number}. Frame {frame}, {pictures[0]['time_s']:.2f} s" + (f": {why}" if why else "")
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


def _seen_then(session: Session, frame: int) -> str:
    if frame not in session.joints.frame:
        return ""
    states = _states(session, frame)
    seen, lost = int((states == 0).sum()), int((states == LOST).sum())
    return f"{seen} of {len(states)} joints seen, {len(states) - seen - lost} inferred, {lost} lost."


def _states(session: Session, frame: int) -> np.ndarray:
    states: np.ndarray = session.joints.state_code[int(np.flatnonzero(session.joints.frame == frame)[0])]
    return states


REPORT_FILE: Final = "report.html"

DARK: Final = (
    "Upright is dark where all joints that tell it were seen, light where one was inferred; what is not upright "
    "is empty, seen or not, and half a column cannot be told. A contact is light from beginning to end, and dark up to "
    "the share of the touching skin that was seen: an average over the contact, not which of its moments were seen."
)
"""How the rows of posture and contacts are read."""


def write_report(results: Path) -> Path:
    """Writes report.html into a results folder and returns its path; the same folder gives the same bytes.

    Raises InputError where a table or run.json is missing or cannot be used; nothing is written then.
    """
    session = read_session(results)
    write_text_whole(results / REPORT_FILE, _page(session))
    return results / REPORT_FILE


def page_parts() -> dict[str, str]:
    """What the pages of this package have in common: their style, their script and how a timeline is read."""
    folder = resources.files("anchorpose.report")
    files = (("style", "css"), ("script", "js"))
    return {name: folder.joinpath(f"page.{kind}").read_text("utf-8") for name, kind in files} | {"dark": DARK}


def _page(session: Session) -> str:
    parts = {
        "summary": summary(session),
        "timeline": timeline(session),
        "measures": measure_section(session),
        "angles": angle_section(session),
        "states": state_table(session),
        "joints": joint_section(session),
        "pictures": frame_pictures(session),
        "exclusions": exclusions(session),
        "provenance": provenance(session),
        "thinned": _thinned(session),
    }
    parts["sources"] = session.ledger.sources()  # last: all others have told by now what they took
    values = {name: Markup(html) for name, html in (parts | page_parts()).items()}
    return render_page("anchorpose.report", "page.html", title=f"Stand training: {session.recording}", **values)


def _thinned(session: Session) -> str:
    if not session.bins.thinned:
        return "Every frame is drawn."
    frames, groups = counted(len(session.joints.frame), "frame"), counted(session.bins.count, "group")
    return (
        f"The {frames} are drawn in {groups} of neighbours, each from its lowest to its highest value, so that peaks "
        "stay (a line runs in the middle, a darker band from the one to the other); all frames are in the tables."
    )
