"""Compute in which frames the patient is touched, the seen share of the touches, and the touched time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from anchorpose.results.frame_time import unbroken_runs
from anchorpose.results.records import Contact

NO_CONTACTS: Final = "the results folder has no contacts.parquet; track the recording again"
NO_EQUIPMENT: Final = (
    "contacts with the equipment are unknown: the recording has no model of it (equipment.json), or a version that "
    "did not search them tracked it"
)
NEVER_FOUND: Final = "the patient was found in no frame"
NO_UPRIGHT: Final = "the patient was never known to be upright"


class Touch(NamedTuple):
    """Touches in each frame. at_once (n,) int32: number of contacts; seen (n,): the largest ``Contact.seen_share`` (1:
    cameras saw the whole touch) of these contacts, 0 without contacts.
    """

    at_once: np.ndarray
    seen: np.ndarray

    def where(self, frames: np.ndarray) -> Touch:
        """Return the touches in the chosen ``frames`` (n,) bool, and no contacts in all other frames."""
        return Touch(np.where(frames, self.at_once, 0), np.where(frames, self.seen, 0.0))

    @property
    def inferred_share(self) -> float | None:
        """Return the unseen share of the touches (1 - ``seen``), as the mean over the frames with any contact; None
        without such frames.
        """
        any_of = self.at_once > 0
        return float(np.mean(1.0 - self.seen[any_of])) if any_of.any() else None


def touch_of(frame: np.ndarray, contacts: Sequence[Contact]) -> Touch:
    """Return the touches at frames (n,), increasing; a contact includes its first and its last frame."""
    count, seen = np.zeros(len(frame), dtype=np.int32), np.zeros(len(frame))
    starts = np.searchsorted(frame, [contact.first_frame for contact in contacts], side="left")
    ends = np.searchsorted(frame, [contact.last_frame for contact in contacts], side="right")
    for contact, start, end in zip(contacts, starts.tolist(), ends.tolist(), strict=True):
        count[start:end] += 1
        np.maximum(seen[start:end], contact.seen_share, out=seen[start:end])
    return Touch(count, seen)


def time_with_sigma(touch: Touch, seconds: np.ndarray, time_s: np.ndarray) -> tuple[float, float | None]:
    """Return the time with any contact, and its sigma.

    Without contacts, sigma is None, since it is unknown how many contacts were missed. Sigma combines two errors: each
    beginning and end of a contact may be wrong by one frame, and unseen contacts may not have existed.
    """
    any_of = touch.at_once > 0
    if not any_of.any():
        return 0.0, None
    edges = 2 * len(unbroken_runs(any_of, time_s))
    unsure_s = float(((1.0 - touch.seen) * seconds)[any_of].sum())
    return float(seconds[any_of].sum()), sigma_of_time(edges, unsure_s, seconds)


def sigma_of_time(edges: int, unsure_s: float, seconds: np.ndarray) -> float:
    """Return the standard deviation (sigma) of a measured time. The time has ``edges`` beginnings and ends, each wrong
    by up to a frame, and lies between two limits that are ``unsure_s`` apart. seconds (n,): the time that each frame
    represents.
    """
    return float(np.hypot(np.sqrt(edges) * float(np.median(seconds)), unsure_s / np.sqrt(12.0)))
