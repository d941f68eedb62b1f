"""Compare the contacts (with people and equipment) found by tracking with the true contacts, by frame and body part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anchorpose.body.contact_regions import REGION_BONES, REGIONS
from anchorpose.results.records import (
    INFERRED,
    SEEN,
    Contact,
    read_contacts,
    read_equipment_names,
    with_equipment,
    with_people,
)
from anchorpose.results.truth import TrueTouch, read_true_support, read_true_touch


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactScore:
    """Scores of how well contacts were found; a share is None if its denominator is 0.

    precision: share of the reported pairs of part and frame in which a bone of the part is truly touched. recall: share
    of the truly touched pairs of part and frame in which this part, or another part that shares a bone with it, is
    reported. The truth states the touched bones, and a knee is not a bone: in the truth, a held knee is a touched
    thigh, a touched shank, or both.
    """

    reported: int  # number of reported pairs of part and frame
    touched: int  # number of truly touched pairs of part and frame
    precision: float | None
    recall: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactEvaluation:
    """Scores of all parts together, of each part that was touched or reported, and of all parts when only seen or only
    inferred contacts count.
    """

    overall: ContactScore
    per_part: tuple[tuple[str, ContactScore], ...]
    per_state: tuple[tuple[str, ContactScore], ...]


def score_contacts(
    table: Path, truth: Path, frame: np.ndarray, rows: np.ndarray
) -> tuple[ContactEvaluation | None, ContactEvaluation | None]:
    """Evaluate the contacts of a contacts.parquet; return the scores of contacts with people, then of contacts with
    equipment. Each result is None if the truth does not state such contacts. The result for equipment is also None if
    tracking did not search for contacts with equipment.

    rows (t,): indices of the compared frames of the truth; frame (t,): for each of them, the number of the matching
    frame of the result.
    """
    contacts = read_contacts(table)
    touched, supported = read_true_touch(truth), read_true_support(truth) if read_equipment_names(table) else None
    pairs = ((with_people(contacts), touched), (with_equipment(contacts), supported))
    people, equipment = (
        None if true is None else evaluate_contacts(some, frame, TrueTouch(true.bones[rows], true.names))
        for some, true in pairs
    )
    return people, equipment


def evaluate_contacts(contacts: Sequence[Contact], frame: np.ndarray, truth: TrueTouch) -> ContactEvaluation:
    """Evaluate the contacts of a result against the truth. frame (t,): number of the result's frame that is matched to
    each frame of the truth.
    """
    holds = np.array([[name in bones for name in truth.names] for bones in REGION_BONES.values()])  # (regions, bones)
    own = np.array([not name.startswith("knee") for name in REGIONS])  # a knee has no bone of its own
    touched = truth.bones @ holds.T  # (t, regions) bool: whether any bone of the region is touched
    due, shared = touched & own, holds @ holds.T
    reported = reported_parts(contacts, frame)
    found = reported @ shared
    scores = [(name, _score(reported[:, k], touched[:, k], due[:, k], found[:, k])) for k, name in enumerate(REGIONS)]
    by_state = {
        state: reported_parts([contact for contact in contacts if contact.state == state], frame)
        for state in (SEEN, INFERRED)
    }
    return ContactEvaluation(
        overall=_score(reported, touched, due, found),
        per_part=tuple((name, score) for name, score in scores if score.reported or score.touched),
        per_state=tuple((state, _score(some, touched, due, some @ shared)) for state, some in by_state.items()),
    )


def reported_parts(contacts: Sequence[Contact], frame: np.ndarray) -> np.ndarray:
    """Return (t, regions) bool: whether one of the contacts touches the region in the frame of the truth. frame (t,):
    number of the result's frame that is matched to each frame of the truth.
    """
    reported = np.zeros((len(frame), len(REGIONS)), dtype=bool)
    for contact in contacts:
        reported[(frame >= contact.first_frame) & (frame <= contact.last_frame), REGIONS.index(contact.part)] = True
    return reported


def _score(reported: np.ndarray, touched: np.ndarray, due: np.ndarray, found: np.ndarray) -> ContactScore:
    return ContactScore(
        reported=int(reported.sum()),
        touched=int(due.sum()),
        precision=float((reported & touched).sum() / reported.sum()) if reported.any() else None,
        recall=float((due & found).sum() / due.sum()) if due.any() else None,
    )
