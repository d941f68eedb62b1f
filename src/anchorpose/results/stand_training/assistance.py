"""Assistance from the contacts: who touches the patient where and for how long, and how much while upright."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from anchorpose.results.frame_time import unbroken_runs
from anchorpose.results.records import Contact, Measure
from anchorpose.results.stand_training.stance import Session


class Touch(NamedTuple):
    """at_once (n,) int32: how many contacts hold in each frame; seen (n,): the greatest seen share of these, 0 where
    none does."""

    at_once: np.ndarray
    seen: np.ndarray

    def where(self, frames: np.ndarray) -> Touch:
        """Nothing in the other frames; frames (n,) bool."""
        return Touch(np.where(frames, self.at_once, 0), np.where(frames, self.seen, 0.0))


def touch_of(frame: np.ndarray, contacts: Sequence[Contact]) -> Touch:
    """In each frame, (n,) increasing; a contact's first and last belong to it."""
    count, seen = np.zeros(len(frame), dtype=np.int32), np.zeros(len(frame))
    starts = np.searchsorted(frame, [contact.first_frame for contact in contacts], side="left")
    ends = np.searchsorted(frame, [contact.last_frame for contact in contacts], side="right")
    for contact, start, end in zip(contacts, starts.tolist(), ends.tolist(), strict=True):
        count[start:end] += 1
        np.maximum(seen[start:end], contact.seen_share, out=seen[start:end])
    return Touch(count, seen)


def time_with_sigma(touch: Touch, seconds: np.ndarray, time_s: np.ndarray) -> tuple[float, float | None]:
    """Time with any contact, and its sigma.

    No sigma without contacts: how many were missed is unknown here. Each beginning and each end may be a frame off; the
    unseen part of a contact may or may not have been there.
    """
    any_of = touch.at_once > 0
    if not any_of.any():
        return 0.0, None
    edges = 2 * len(unbroken_runs(any_of, time_s))
    usual = float(np.median(seconds))
    unsure = float(((1.0 - touch.seen) * seconds)[any_of].sum())
    return float(seconds[any_of].sum()), float(np.hypot(np.sqrt(edges) * usual, unsure / np.sqrt(12.0)))


def inferred_touch_share(touch: Touch) -> float | None:
    """Share of the frames with any contact in which none was seen; None for no frames."""
    any_of = touch.at_once > 0
    return float(np.mean(1.0 - touch.seen[any_of])) if any_of.any() else None


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
    groups: dict[tuple[str | None, str | None], list[Contact]] = {(None, None): list(contacts)}
    parts, persons = sorted({c.part for c in contacts}), sorted({c.person for c in contacts})
    for key in (*((None, who) for who in persons), *((part, None) for part in parts), *product(parts, persons)):
        groups[key] = []
    for contact in contacts:
        for key in ((None, contact.person), (contact.part, None), (contact.part, contact.person)):
            groups[key].append(contact)
    rows = list[Measure]()
    for (part, person), some in groups.items():
        if some or (part, person) == (None, None):
            rows += _of_group(session, some, part, person)
    return rows + _while_upright(session, contacts)


def _of_group(session: Session, contacts: Sequence[Contact], part: str | None, person: str | None) -> list[Measure]:
    touch = touch_of(session.joints.frame, contacts).where(session.found)
    time_s, sigma_s = time_with_sigma(touch, session.seconds, session.joints.time_s)
    frames, shared = int((touch.at_once > 0).sum()), inferred_touch_share(touch)
    side = next((end for end in ("left", "right") if part is not None and part.endswith(f"_{end}")), None)
    rows = [("assistance_time", time_s, "s", sigma_s), ("contacts", float(len(contacts)), "count", None)]
    return [
        Measure(
            measure=name,
            side=side,
            part=part,
            person=person,
            value=value,
            unit=unit,
            sigma=sigma,
            frames=frames,
            inferred_share=shared,
        )
        for name, value, unit, sigma in rows
    ]


def _while_upright(session: Session, contacts: Sequence[Contact]) -> list[Measure]:
    """Shares of the upright time, with hands on and without, and how many contacts there were at once."""
    standing = session.upright
    frames, upright_s = int(standing.sum()), float(session.seconds[standing].sum())
    if not upright_s:
        return [
            Measure(measure=name, value=None, unit=unit, frames=0, why=NO_UPRIGHT)
            for name, unit in CONTACT_MEASURES[2:]
        ]
    helped = touch_of(session.joints.frame, contacts).where(session.found & standing)
    at_once = helped.at_once[standing]
    helped_s, sigma_s = time_with_sigma(helped, session.seconds, session.joints.time_s)
    mean = float(np.average(at_once, weights=session.seconds[standing]))
    shared = inferred_touch_share(helped)
    of_help = (shared, None, None, shared, shared)  # time without any contact rests on none that was inferred
    values = (helped_s / upright_s, upright_s - helped_s, 1.0 - helped_s / upright_s, mean, float(at_once.max()))
    share_sigma = None if sigma_s is None else sigma_s / upright_s
    sigmas = (share_sigma, sigma_s, share_sigma, None, None)
    return [
        Measure(measure=name, value=value, unit=unit, sigma=sigma, frames=frames, inferred_share=inferred)
        for (name, unit), value, sigma, inferred in zip(CONTACT_MEASURES[2:], values, sigmas, of_help, strict=True)
    ]
