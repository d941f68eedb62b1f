"""The EVENT group of a C3D: foot off and foot strike, standing up and sitting down, contacts.

Mokka, Visual3D, Nexus and ezc3d read it: LABELS and CONTEXTS name each event, TIMES has minutes and seconds from the
file's first frame. "Foot Strike" and "Foot Off" in the contexts Left and Right are the names that these programs know;
the others stand in the context General.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.results.records import (
    CONTACTS_FILE,
    EPISODES_FILE,
    SIT_TO_STAND,
    STAND_TO_SIT,
    STEP_LEFT,
    STEP_RIGHT,
    UPRIGHT_EPISODE,
    read_contacts,
    read_episodes,
)

MOST_EVENTS: Final = 255
"""A dimension of a parameter is one byte."""

GENERAL: Final = "General"

_NAMES: Final = {
    STEP_LEFT: ("Left", "Foot Off", "Foot Strike"), STEP_RIGHT: ("Right", "Foot Off", "Foot Strike"),
    SIT_TO_STAND: (GENERAL, "Stand Up Start", "Stand Up End"),
    STAND_TO_SIT: (GENERAL, "Sit Down Start", "Sit Down End"),
    UPRIGHT_EPISODE: (GENERAL, "Upright Start", "Upright End"),
}  # fmt: skip


@dataclass(frozen=True, slots=True, order=True)
class Event:
    """A moment on the clock of the results; description: the joints' state, or who touched."""

    time_s: float
    context: str
    label: str
    description: str


def read_events(folder: Path) -> tuple[Event, ...]:
    """Beginnings and ends of a results folder's episodes and contacts, in the order of time; none without tables."""
    return tuple(sorted([*_of_episodes(folder / EPISODES_FILE), *_of_contacts(folder / CONTACTS_FILE)]))


def _of_episodes(path: Path) -> Iterator[Event]:
    for episode in read_episodes(path) if path.is_file() else ():
        context, begins, ends = _NAMES[episode.kind]
        yield Event(episode.start_s, context, begins, str(episode.state))
        yield Event(episode.end_s, context, ends, str(episode.state))


def _of_contacts(path: Path) -> Iterator[Event]:
    for contact in read_contacts(path) if path.is_file() else ():
        words = f"{contact.part} by {contact.person}, {contact.state}"
        yield Event(contact.start_s, GENERAL, "Contact Start", words)
        yield Event(contact.end_s, GENERAL, "Contact End", words)


def add_events(file: Any, events: tuple[Event, ...], time_s: np.ndarray) -> int:
    """Adds the group to an ezc3d file with frames at time_s (n,); returns how many events it holds.

    Events outside of the file's time are left out; of more than ``MOST_EVENTS``, those of contacts and posture first.
    """
    inside = [event for event in events if time_s[0] <= event.time_s <= time_s[-1]]
    kept = sorted(sorted(inside, key=lambda event: event.context == GENERAL)[:MOST_EVENTS])
    if not kept:
        return 0
    seconds = np.array([event.time_s for event in kept]) - time_s[0]
    file.add_parameter("EVENT", "USED", [len(kept)])
    file.add_parameter("EVENT", "CONTEXTS", [event.context for event in kept])
    file.add_parameter("EVENT", "LABELS", [event.label for event in kept])
    file.add_parameter("EVENT", "DESCRIPTIONS", [event.description for event in kept])
    file.add_parameter("EVENT", "SUBJECTS", ["" for _ in kept])
    file.add_parameter("EVENT", "TIMES", np.stack([np.floor(seconds / 60.0), seconds % 60.0]))
    file.add_parameter("EVENT", "ICON_IDS", [0 for _ in kept])
    file.add_parameter("EVENT", "GENERIC_FLAGS", [0 for _ in kept])
    return len(kept)
