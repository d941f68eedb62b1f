"""What was left out of a session and what was kept of it, as rows of its timeline."""

from __future__ import annotations

import numpy as np

from anchorpose.report.chart import Row
from anchorpose.report.paths import step_path
from anchorpose.report.session import Session


def kept_rows(session: Session) -> list[Row]:
    """Frames with problems, frames that a reviewer took out, and the pictures, each a link to its place on the page."""
    bad = np.isin(session.joints.frame, [drop["frame"] for drop in session.run.get("dropped", [])])
    rows = [
        *_marked(session, "frames with problems", bad),
        *_marked(session, "marked unusable by a reviewer", unusable_frames(session)),
        *_pictures(session),
    ]
    return [Row(label="Kept and left out", height=0, shapes="", kind="heading"), *rows] if rows else []


def unusable_frames(session: Session) -> np.ndarray:
    """(n,) bool: the frames that a reviewer has taken out."""
    entries = (session.run.get("corrections") or {}).get("unusable", [])
    frame, marked = session.joints.frame, np.zeros(len(session.joints.frame), dtype=bool)
    for entry in entries:
        marked |= (entry["first_frame"] <= frame) & (frame <= entry["last_frame"])
    return marked


def _marked(session: Session, label: str, frames: np.ndarray) -> list[Row]:
    """One row with a column wherever one of the ``frames`` (n,) bool lies; none without any."""
    if not frames.any():
        return []
    level = np.maximum.reduceat(frames.astype(float), session.bins.start)
    return [
        Row(label=label, height=12, shapes=f"<path class='lost' d='{step_path(level, session.bins)}'/>", kind="state")
    ]


def _pictures(session: Session) -> list[Row]:
    kept = (p for p in session.run.get("pictures", []) if (session.folder / p["file"]).is_file())
    times = dict.fromkeys((picture["frame"], picture["time_s"]) for picture in kept)
    if not times:
        return []
    marks = "".join(
        f"<a class='kept' style='left:{100 * session.bins.place_of(np.array([time_s]))[0]:.2f}%' "
        f"href='#frame-{frame}' aria-label='pictures of frame {frame}'>{number}</a>"
        for number, (frame, time_s) in enumerate(times, 1)
    )
    return [Row(label="pictures", height=26, shapes="", marks=marks, kind="marks")]
