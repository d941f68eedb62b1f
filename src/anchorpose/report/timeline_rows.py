"""Rows of the timeline for what happened: posture and transitions, contacts, frames left out and pictures kept.

A contact is light from its beginning to its end, and dark up to the share of the touching skin that was seen. That
share is one number for the whole contact: the tables do not say which of its moments were seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.body.contact_regions import REGIONS
from anchorpose.joints import JointState
from anchorpose.report.chart import Column, Mark, Reading, Row, heading
from anchorpose.report.curves import step_path
from anchorpose.report.ledger import Form
from anchorpose.report.session import Bins, Session
from anchorpose.report.words import STATE_WORDS, named_part
from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.records import SIT_TO_STAND, STAND_TO_SIT, Contact, Episode
from anchorpose.results.tables import NOT_UPRIGHT, UPRIGHT


def kept_rows(session: Session) -> list[Row]:
    """Frames with problems, frames marked unusable by a reviewer, and the pictures, each a link to its section."""
    bad = np.isin(session.joints.frame, [drop["frame"] for drop in session.run.get("dropped", [])])
    rows = [
        *marked_row(session, "frames with problems", bad),
        *marked_row(session, "marked unusable by a reviewer", unusable_frames(session)),
        *_pictures(session),
    ]
    return [heading("Kept and left out"), *rows] if rows else []


def unusable_frames(session: Session) -> np.ndarray:
    """(n,) bool: the frames that a reviewer marked as unusable."""
    entries = (session.run.get("corrections") or {}).get("unusable", [])
    frame, marked = session.joints.frame, np.zeros(len(session.joints.frame), dtype=bool)
    for entry in entries:
        marked |= (entry["first_frame"] <= frame) & (frame <= entry["last_frame"])
    return marked


def marked_row(session: Session, label: str, frames: np.ndarray) -> list[Row]:
    """One row with a column wherever one of the ``frames`` (n,) bool lies; no row where there are none."""
    if not frames.any():
        return []
    level = np.maximum.reduceat(frames.astype(float), session.bins.start)
    return [Row(label=label, height=12, shapes=(("lost", step_path(level, session.bins)),), kind="state")]


def _pictures(session: Session) -> list[Row]:
    kept = (p for p in session.run.get("pictures", []) if (session.folder / p["file"]).is_file())
    times = dict.fromkeys((picture["frame"], picture["time_s"]) for picture in kept)
    if not times:
        return []
    places = session.bins.place_of(np.array([time_s for _, time_s in times])).tolist()
    marks = tuple(
        Mark(
            text=str(number),
            kind="kept",
            style=f"left:{100 * place:.2f}%",
            title=f"pictures of frame {frame}",
            link=f"#frame-{frame}",
        )
        for number, ((frame, _), place) in enumerate(zip(times, places, strict=True), 1)
    )
    return [Row(label="pictures", height=26, marks=marks, kind="marks")]


TRANSITIONS: Final = {SIT_TO_STAND: ("▲", "stands up"), STAND_TO_SIT: ("▼", "sits down")}

POSTURE_WORDS: Final = {UPRIGHT: "upright", NOT_UPRIGHT: "not upright", UNKNOWN: "posture unknown"}


def posture_rows(session: Session) -> list[Row]:
    """A full column is upright, none is not upright, half a column is unknown; a light one is inferred.

    The worst of a group of frames is drawn: dark only where all its upright frames were seen.
    """
    bins, upright = session.bins, session.posture.upright
    unknown, standing, inferred = (
        np.maximum.reduceat(some.astype(float), bins.start)
        for some in (upright == UNKNOWN, upright == UPRIGHT, (upright == UPRIGHT) & ~session.posture_seen)
    )
    shapes = (
        ("lost", step_path(0.5 * unknown, bins)),
        ("posture light", step_path(standing * inferred, bins)),
        ("posture", step_path(standing * (1 - inferred), bins)),
    )
    label = "upright" + (" (half a column: unknown)" if unknown.any() else "")
    rows = [heading("Posture"), Row(label=label, height=18, shapes=shapes, kind="state")]
    marks = tuple(_transition_mark(bins, episode) for episode in session.episodes if episode.kind in TRANSITIONS)
    if marks:
        rows.append(Row(label="▲ stands up, ▼ sits down", height=22, marks=marks, kind="marks"))
    return rows


def posture_readings(session: Session) -> list[Reading]:
    """For each group of frames: every posture in it, and the transitions under way."""
    bins = session.bins
    words = [
        POSTURE_WORDS[code] + ("" if seen or code == UNKNOWN else " (inferred)")
        for code, seen in zip(session.posture.upright.tolist(), session.posture_seen.tolist(), strict=True)
    ]
    postures = [
        " and ".join(dict.fromkeys(words[first : last + 1])) for first, last in zip(bins.start, bins.last, strict=True)
    ]
    moves = [
        " and ".join(
            TRANSITIONS[episode.kind][1]
            for episode in session.episodes
            if episode.kind in TRANSITIONS and episode.first_frame <= last and episode.last_frame >= first
        )
        for first, last in zip(bins.frame[bins.start], bins.frame[bins.last], strict=True)
    ]
    return [Reading(label="", text=Column("posture", postures)), Reading(label="", text=Column("transition", moves))]


def _transition_mark(bins: Bins, episode: Episode) -> Mark:
    begin, end = bins.place_of(np.array([episode.start_s, episode.end_s])).tolist()
    sign, words = TRANSITIONS[episode.kind]
    return Mark(
        text=sign,
        kind="move" if episode.state is JointState.OBSERVED else "move unsure",
        style=f"left:{100 * begin:.2f}%;width:{100 * (end - begin):.2f}%",
        title=f"{words}, {episode.start_s:.1f} to {episode.end_s:.1f} s, {STATE_WORDS[episode.state]}",
    )


SEEN_SHARE: Final = Form(times=100.0, after=" % seen", share=True)


def touch_rows(session: Session) -> list[Row]:
    """One row per part and person, from head to foot."""
    rows = [heading("Touched by")]
    if session.contacts is None:
        return [*rows, Row(label="not known: no contacts.parquet", height=14, kind="state")]
    touched = sorted({(REGIONS.index(c.part), c.person) for c in session.contacts}, key=_natural)
    rows += _lost_row(session)
    if not touched:
        return [*rows, Row(label="nobody, as far as was seen", height=14, kind="state")]
    for part, person in touched:
        contacts = [c for c in session.contacts if c.part == REGIONS[part] and c.person == person]
        held, seen = _held_and_seen(contacts, session.bins)
        shapes = (("touch light", step_path(held, session.bins)), ("touch", step_path(seen, session.bins)))
        rows.append(Row(label=f"{named_part(REGIONS[part])}: {person}", height=15, shapes=shapes, kind="state"))
    return rows


def touch_reading(session: Session) -> Reading:
    """For each group of frames: every part that is touched in it, by whom, and how much of that contact was seen."""
    first, last = session.bins.frame[session.bins.start], session.bins.frame[session.bins.last]
    texts: list[list[str]] = [["not known: patient lost"] if lost else [] for lost in _lost(session)]
    for contact in sorted(session.contacts or (), key=lambda c: (REGIONS.index(c.part), c.person, c.start_s)):
        text = f"{named_part(contact.part)} by {contact.person} ({SEEN_SHARE.write(contact.seen_share)})"
        for k in np.flatnonzero((contact.first_frame <= last) & (contact.last_frame >= first)):
            texts[k].append(text.replace(",", " "))
    return Reading(label="touched", text=Column("touched", ["; ".join(dict.fromkeys(text)) for text in texts]))


def _lost_row(session: Session) -> list[Row]:
    """Where touch is unknown because the patient was not found; none for a patient found throughout."""
    lost = _lost(session)
    shapes = (("lost", step_path(0.5 * lost, session.bins)),)
    return [Row(label="not known: patient lost", height=15, shapes=shapes, kind="state")] if lost.any() else []


def _lost(session: Session) -> np.ndarray:
    """(b,) 1.0 for groups of frames in one of which no joint was found."""
    return np.maximum.reduceat(session.joints.lost.all(axis=1).astype(float), session.bins.start)


def _held_and_seen(contacts: Sequence[Contact], bins: Bins) -> tuple[np.ndarray, np.ndarray]:
    """(b,) 1.0 for groups of frames in which one of the contacts goes on; and the least share seen of those."""
    held, seen = np.zeros(bins.count), np.ones(bins.count)
    for contact in contacts:
        there = (contact.first_frame <= bins.frame[bins.last]) & (contact.last_frame >= bins.frame[bins.start])
        held[there], seen[there] = 1.0, np.minimum(seen[there], contact.seen_share)
    return held, held * seen


def _natural(item: tuple[int, str]) -> tuple[int, int, str]:
    """Person 10 after person 9."""
    part, person = item
    digits = "".join(filter(str.isdigit, person))
    return part, int(digits) if digits else 0, person
