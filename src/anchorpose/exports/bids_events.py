"""Contacts and episodes as BIDS events: what happened when, beside the motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from anchorpose.exports.numbers_text import rounded_text
from anchorpose.results.contacts import CONTACTS_FILE, read_contacts
from anchorpose.results.episodes import EPISODES_FILE, read_episodes

EVENT_COLUMNS: Final = ("onset", "duration", "trial_type", "part", "person", "state")


def events_of(folder: Path, start_s: float, missing: str) -> list[tuple[str, ...]]:
    """Rows in order of onset, seconds since ``start_s``; none where the results have neither table."""
    found: list[tuple[float, float, str, str, str, str]] = []
    if (folder / CONTACTS_FILE).exists():
        found += [
            (contact.start_s, contact.end_s, "contact", contact.part, contact.person, contact.state)
            for contact in read_contacts(folder / CONTACTS_FILE)
        ]
    if (folder / EPISODES_FILE).exists():
        found += [
            (episode.start_s, episode.end_s, episode.kind, missing, missing, str(episode.state))
            for episode in read_episodes(folder / EPISODES_FILE)
        ]
    return [
        (rounded_text(start - start_s, 6, missing), rounded_text(end - start, 6, missing), *texts)
        for start, end, *texts in sorted(found)
    ]


def events_sidecar() -> dict[str, Any]:
    """What the columns mean that BIDS does not define."""
    return {
        "trial_type": {
            "Levels": {
                "contact": "somebody's skin is within about 3 cm of the patient's",
                "upright": "the patient stands upright",
                "sit_to_stand": "the patient stands up",
                "stand_to_sit": "the patient sits down",
            }
        },
        "part": {"Description": "region of the patient's body that is touched"},
        "person": {"Description": "who touches; a name that stays the same while this person is followed"},
        "state": {"Description": "whether it was seen or is inferred"},
    }
