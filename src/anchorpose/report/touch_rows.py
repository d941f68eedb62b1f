"""Who touches which part when, as rows of the timeline.

A contact fills its row in light from its beginning to its end, and in dark up to the share of the touching skin that
was seen. That share is one number for the whole contact: at which of its moments it was seen is not in the tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.body.regions import REGIONS
from anchorpose.report.bins import Bins
from anchorpose.report.chart import Column, Reading, Row
from anchorpose.report.ledger import Form
from anchorpose.report.paths import step_path
from anchorpose.report.session import Session
from anchorpose.report.words import escape, named_part
from anchorpose.results.contacts import Contact

SEEN_SHARE: Final = Form(times=100.0, after=" % seen", share=True)


def touch_rows(session: Session) -> list[Row]:
    """One row a part and person, from head to foot."""
    rows = [Row(label="Touched by", height=0, shapes="", kind="heading")]
    if session.contacts is None:
        return [*rows, Row(label="not known: no contacts.parquet", height=14, shapes="", kind="state")]
    touched = sorted({(REGIONS.index(c.part), c.person) for c in session.contacts}, key=_natural)
    rows += _lost_row(session)
    if not touched:
        return [*rows, Row(label="nobody, as far as was seen", height=14, shapes="", kind="state")]
    for part, person in touched:
        mine = [c for c in session.contacts if c.part == REGIONS[part] and c.person == person]
        held, seen = _held_and_seen(mine, session.bins)
        shapes = (
            f"<path class='touch light' d='{step_path(held, session.bins)}'/>"
            f"<path class='touch' d='{step_path(seen, session.bins)}'/>"
        )
        label = f"{escape(named_part(REGIONS[part]))}: {escape(person)}"
        rows.append(Row(label=label, height=15, shapes=shapes, kind="state"))
    return rows


def touch_reading(session: Session) -> Reading:
    """Of each group of frames every part that is touched in it, by whom, and how much of that contact was seen."""
    first, last = session.bins.frame[session.bins.start], session.bins.frame[session.bins.last]
    texts: list[list[str]] = [["not known: patient lost"] if lost else [] for lost in _lost(session)]
    for contact in sorted(session.contacts or (), key=lambda c: (REGIONS.index(c.part), c.person, c.start_s)):
        told = f"{named_part(contact.part)} by {contact.person} ({SEEN_SHARE.write(contact.seen_share)})"
        for k in np.flatnonzero((contact.first_frame <= last) & (contact.last_frame >= first)):
            texts[k].append(told.replace(",", " "))
    return Reading(label="touched", text=Column("touched", ["; ".join(dict.fromkeys(text)) for text in texts]))


def _lost_row(session: Session) -> list[Row]:
    """Where nobody can be told to touch the patient, since he was not found; none of a patient found throughout."""
    lost = _lost(session)
    shapes = f"<path class='lost' d='{step_path(0.5 * lost, session.bins)}'/>"
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
