"""Who touches which part when, as rows of the timeline: a full column where it was seen, half of one where inferred."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anchorpose.body.regions import REGIONS
from anchorpose.report.bins import Bins
from anchorpose.report.chart import Column, Reading, Row
from anchorpose.report.paths import step_path
from anchorpose.report.session import Session
from anchorpose.report.words import escape, named_part
from anchorpose.results.contacts import SEEN, Contact


def touch_rows(session: Session) -> list[Row]:
    """One row a part and person, from head to foot."""
    touched = sorted({(REGIONS.index(c.part), c.person) for c in session.contacts}, key=_natural)
    rows = [Row(label="Touched by", height=0, shapes="", kind="heading")]
    if not touched:
        return [*rows, Row(label="nobody, as far as was seen", height=14, shapes="", kind="state")]
    for part, person in touched:
        mine = [c for c in session.contacts if c.part == REGIONS[part] and c.person == person]
        seen, inferred = (
            _covered([c for c in mine if (c.state == SEEN) is sight], session.bins) for sight in (True, False)
        )
        shapes = (
            f"<path class='touch' d='{step_path(seen, session.bins)}'/>"
            f"<path class='touch unsure' d='{step_path(0.5 * inferred * (1 - seen), session.bins)}'/>"
        )
        label = f"{escape(named_part(REGIONS[part]))}: {escape(person)}"
        rows.append(Row(label=label, height=15, shapes=shapes, kind="state"))
    return rows


def touch_reading(session: Session) -> Reading:
    """Of each group of frames every part that is touched in it, and by whom."""
    first, last = session.bins.frame[session.bins.start], session.bins.frame[session.bins.last]
    texts: list[list[str]] = [[] for _ in first]
    for contact in sorted(session.contacts, key=lambda c: (REGIONS.index(c.part), c.person, c.start_s)):
        for k in np.flatnonzero((contact.first_frame <= last) & (contact.last_frame >= first)):
            texts[k].append(f"{named_part(contact.part)} by {contact.person} ({contact.state})".replace(",", " "))
    return Reading(label="touched", text=Column("touched", ["; ".join(dict.fromkeys(text)) for text in texts]))


def _covered(contacts: Sequence[Contact], bins: Bins) -> np.ndarray:
    """(b,) 1.0 for groups of frames in which one of the contacts goes on."""
    level = np.zeros(bins.count)
    for contact in contacts:
        level[(contact.first_frame <= bins.frame[bins.last]) & (contact.last_frame >= bins.frame[bins.start])] = 1.0
    return level


def _natural(item: tuple[int, str]) -> tuple[int, int, str]:
    """Person 10 after person 9."""
    part, person = item
    digits = "".join(filter(str.isdigit, person))
    return part, int(digits) if digits else 0, person
