"""In which frames somebody touched the patient."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anchorpose.results.contacts import Contact
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

    Each beginning and each end may be a frame off; and of a contact that was seen in part, the rest may or may not be.
    """
    any_of, seen = _any_and_seen(held, contacts)
    edges = 2 * len(unbroken_runs(any_of, time_s))
    usual = float(np.median(seconds)) if len(seconds) else 0.0
    unsure = float(((1.0 - seen) * seconds)[any_of].sum())
    if not any_of.any():
        return 0.0, None
    return float(seconds[any_of].sum()), float(np.hypot(np.sqrt(edges) * usual, unsure / np.sqrt(12.0)))


def inferred_touch_share(held: np.ndarray, contacts: Sequence[Contact]) -> float | None:
    """Of the frames with any of the contacts, the part in which none was seen; None of no frames."""
    any_of, seen = _any_and_seen(held, contacts)
    return float(np.mean(1.0 - seen[any_of])) if any_of.any() else None


def _any_and_seen(held: np.ndarray, contacts: Sequence[Contact]) -> tuple[np.ndarray, np.ndarray]:
    """(n,) bool: frames with a contact; (n,): the greatest share seen of those that hold, 0 where none does."""
    shares = np.array([contact.seen_share for contact in contacts], dtype=np.float64)
    return np.any(held, axis=0, keepdims=True)[0], np.max(held * shares[:, None], axis=0, initial=0.0)
