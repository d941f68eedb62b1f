"""In which frames somebody touched the patient."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anchorpose.results.contacts import SEEN, Contact
from anchorpose.results.frame_time import unbroken_runs


def touched_frames(frame: np.ndarray, contacts: Sequence[Contact]) -> np.ndarray:
    """(c, n) bool: whether each contact holds in each frame; both its ends belong to it."""
    first = np.array([contact.first_frame for contact in contacts], dtype=np.int64)
    last = np.array([contact.last_frame for contact in contacts], dtype=np.int64)
    held: np.ndarray = (frame >= first[:, None]) & (frame <= last[:, None])
    return held


def time_with_sigma(
    held: np.ndarray, contacts: Sequence[Contact], seconds: np.ndarray, time_s: np.ndarray
) -> tuple[float, float | None]:
    """Time with any of the contacts, and its sigma; held (c, n) of ``touched_frames``.

    No sigma without contacts: how many were missed is not known here.

    Each beginning and each end may be a frame off; and time that rests on inferred contacts alone may or may not be.
    """
    any_of, seen = _any_and_seen(held, contacts)
    edges = 2 * len(unbroken_runs(any_of, time_s))
    usual = float(np.median(seconds)) if len(seconds) else 0.0
    unsure = float(seconds[any_of & ~seen].sum())
    if not any_of.any():
        return 0.0, None
    return float(seconds[any_of].sum()), float(np.hypot(np.sqrt(edges) * usual, unsure / np.sqrt(12.0)))


def inferred_touch_share(held: np.ndarray, contacts: Sequence[Contact]) -> float | None:
    """Of the frames with any of the contacts, those in which none of them was seen; None of no frames."""
    any_of, seen = _any_and_seen(held, contacts)
    return float(np.mean(~seen[any_of])) if any_of.any() else None


def _any_and_seen(held: np.ndarray, contacts: Sequence[Contact]) -> tuple[np.ndarray, np.ndarray]:
    """(n,) bool each: frames with a contact, and those with one that was seen."""
    were_seen = np.array([contact.state == SEEN for contact in contacts], dtype=bool)
    return np.any(held, axis=0, keepdims=True)[0], np.any(held[were_seen], axis=0, keepdims=True)[0]
