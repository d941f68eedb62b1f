"""Assistance from the contacts: who touches the patient where and for how long, and how much while upright."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.results.frame_time import unbroken_runs
from anchorpose.results.records import Contact, Measure
from anchorpose.results.stand_training.session import Session


def touched_frames(frame: np.ndarray, contacts: Sequence[Contact]) -> np.ndarray:
    """(c, n) bool: whether each contact holds in each frame, its first and last included."""
    first = np.array([contact.first_frame for contact in contacts], dtype=np.int64)
    last = np.array([contact.last_frame for contact in contacts], dtype=np.int64)
    held: np.ndarray = (frame >= first[:, None]) & (frame <= last[:, None])
    return held


def time_with_sigma(
    held: np.ndarray, contacts: Sequence[Contact], seconds: np.ndarray, time_s: np.ndarray
) -> tuple[float, float | None]:
    """Time with any of the contacts, and its sigma; held (c, n) of ``touched_frames``.

    No sigma without contacts: how many were missed is unknown here. Each beginning and each end may be a frame off; the
    unseen part of a contact may or may not have been there.
    """
    any_of, seen = _any_and_seen(held, contacts)
    edges = 2 * len(unbroken_runs(any_of, time_s))
    usual = float(np.median(seconds)) if len(seconds) else 0.0
    unsure = float(((1.0 - seen) * seconds)[any_of].sum())
    if not any_of.any():
        return 0.0, None
    return float(seconds[any_of].sum()), float(np.hypot(np.sqrt(edges) * usual, unsure / np.sqrt(12.0)))


def inferred_touch_share(held: np.ndarray, contacts: Sequence[Contact]) -> float | None:
    """Share of the frames with any of the contacts in which none was seen; None for no frames."""
    any_of, seen = _any_and_seen(held, contacts)
    return float(np.mean(1.0 - seen[any_of])) if any_of.any() else None


def _any_and_seen(held: np.ndarray, contacts: Sequence[Contact]) -> tuple[np.ndarray, np.ndarray]:
    """(n,) bool: frames with a contact; (n,): the greatest seen share of those that hold, 0 where none does."""
    shares = np.array([contact.seen_share for contact in contacts], dtype=np.float64)
    return np.any(held, axis=0, keepdims=True)[0], np.max(held * shares[:, None], axis=0, initial=0.0)


NO_CONTACTS: Final = "the results folder has no contacts.parquet; track the recording again"
NEVER_FOUND: Final = "the patient was found in no frame"
NO_UPRIGHT: Final = "the patient was never known to be upright"

CONTACT_MEASURES: Final = (
    ("assistance_time", "s"),
    ("contacts", "count"),
    ("assistance_share_upright", "1"),
    ("hands_free_upright_time", "s"),
    ("hands_free_upright_share", "1"),
    ("hands_on_at_once_mean", "count"),
    ("hands_on_at_once_most", "count"),
)


def assistance_measures(session: Session) -> list[Measure]:
    """Of the whole session; then for each person, each part, and each person and part, the time and the contacts.

    Only frames in which the patient was found count: in others contacts are unknown.
    """
    contacts = session.contacts
    if contacts is None or not session.found.any():
        why = NO_CONTACTS if contacts is None else NEVER_FOUND
        return [Measure(measure=name, value=None, unit=unit, frames=0, why=why) for name, unit in CONTACT_MEASURES]
    parts, persons = sorted({c.part for c in contacts}), sorted({c.person for c in contacts})
    groups = [(None, None), *((None, who) for who in persons), *((part, None) for part in parts)]
    groups += [(part, who) for part in parts for who in persons]
    held = touched_frames(session.joints.frame, contacts) & session.found
    rows = list[Measure]()
    for part, person in groups:
        chosen = [part in (None, c.part) and person in (None, c.person) for c in contacts]
        some = [contact for contact, one in zip(contacts, chosen, strict=True) if one]
        if some or (part, person) == (None, None):
            rows += _of_group(session, held[np.array(chosen, dtype=bool)], some, part, person)
    return rows + _while_upright(session, held, contacts)


def _of_group(
    session: Session, held: np.ndarray, contacts: Sequence[Contact], part: str | None, person: str | None
) -> list[Measure]:
    time_s, sigma_s = time_with_sigma(held, contacts, session.seconds, session.joints.time_s)
    frames, shared = int(held.any(axis=0).sum()), inferred_touch_share(held, contacts)
    side = next((end for end in ("left", "right") if part is not None and part.endswith(f"_{end}")), None)
    rows = [("assistance_time", time_s, "s", sigma_s), ("contacts", float(len(contacts)), "count", None)]
    return [
        Measure(measure=name, side=side, part=part, person=person, value=value, unit=unit, sigma=sigma, frames=frames,
                inferred_share=shared)
        for name, value, unit, sigma in rows
    ]  # fmt: skip


def _while_upright(session: Session, held: np.ndarray, contacts: Sequence[Contact]) -> list[Measure]:
    """Shares of the upright time, with hands on and without, and how many contacts there were at once."""
    standing = session.upright
    frames, upright_s = int(standing.sum()), float(session.seconds[standing].sum())
    if not upright_s:
        return [
            Measure(measure=name, value=None, unit=unit, frames=0, why=NO_UPRIGHT)
            for name, unit in CONTACT_MEASURES[2:]
        ]
    helped, at_once = held & standing, held[:, standing].sum(axis=0)
    helped_s, sigma_s = time_with_sigma(helped, contacts, session.seconds, session.joints.time_s)
    mean = float(np.average(at_once, weights=session.seconds[standing]))
    shared = inferred_touch_share(helped, contacts)
    of_help = (shared, None, None, shared, shared)  # time without any contact rests on none that was inferred
    values = (helped_s / upright_s, upright_s - helped_s, 1.0 - helped_s / upright_s, mean, float(at_once.max()))
    share_sigma = None if sigma_s is None else sigma_s / upright_s
    sigmas = (share_sigma, sigma_s, share_sigma, None, None)
    return [
        Measure(measure=name, value=value, unit=unit, sigma=sigma, frames=frames, inferred_share=inferred)
        for (name, unit), value, sigma, inferred in zip(CONTACT_MEASURES[2:], values, sigmas, of_help, strict=True)
    ]
