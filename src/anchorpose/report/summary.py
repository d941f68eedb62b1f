"""What was recorded and how good it is, in plain words, from the tables alone."""

from __future__ import annotations

from typing import Final

import numpy as np
from markupsafe import Markup

from anchorpose.joints import JOINT_NAMES
from anchorpose.report.ledger import Aggregation, Form, Rows
from anchorpose.report.measure_section import rows_of, value_form
from anchorpose.report.session import Session
from anchorpose.report.words import COVERAGE, INFERRED_STATES, counted, listed, named_part
from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.records import CONTACTS_FILE, EPISODES_FILE, SIT_TO_STAND, STAND_TO_SIT, Measure
from anchorpose.results.tables import JOINTS_FILE

JOINTS: Final = Rows(JOINTS_FILE)
CONTACTS: Final = Rows(CONTACTS_FILE)

PERCENT: Final = Form(times=100.0, after=" %", share=True)

SELDOM_SEEN, USUALLY_SEEN = 0.5, 0.9
"""Shares of the frames. Below the first a joint's curve is more inference than measurement, and is named."""

MUCH_LOST, MOSTLY_LOST = 0.1, 0.5
"""Shares of all joint positions; above the first it is the first thing that a reader has to know."""


def summary(session: Session) -> list[Markup]:
    """Paragraphs: what was recorded, what the patient did, how much of it can be used."""
    if session.joints.lost.all():  # nothing is known of what the patient did
        return [_recorded(session), NEVER_FOUND]
    return [_recorded(session), Markup(" ").join([_posture(session), _touch(session)]), _quality(session)]


def seen_shares(session: Session) -> np.ndarray:
    """(21,) share of the frames in which each joint was seen."""
    shares: np.ndarray = (session.joints.state_code == 0).mean(axis=0)
    return shares


def _recorded(session: Session) -> Markup:
    names = [str(camera["name"]) for camera in session.run.get("cameras", [])]
    frame_form = Form(after=" frame" if len(session.joints.frame) == 1 else " frames")
    return Markup("<b>{}</b>: {}, {}{}. {}").format(
        session.recording,
        session.ledger.figure(*_duration(session), Form(decimals=1, after=" s")),
        session.ledger.figure(JOINTS, Aggregation(column="frame", how="distinct"), frame_form),
        f", seen by {counted(len(names), 'camera')} ({listed(names)})" if names else "",
        session.ledger.link(JOINTS),
    )


def _duration(session: Session) -> tuple[Rows, Aggregation]:
    """As the measures have it, in which the last frame lasts as long as the others."""
    measured = _measure(session, "recorded_time")
    if measured is None or measured.value is None:
        return JOINTS, Aggregation(column="time_s", how="extent")
    return rows_of(measured), Aggregation(column="value")


def _measure(session: Session, name: str) -> Measure | None:
    return next((m for m in session.measures if m.measure == name), None)


def _posture(session: Session) -> Markup:
    """The share that stands in the table of measures, and for how long posture is unknown."""
    share, unknown = _measure(session, "upright_share"), _measure(session, "unknown_time")
    if share is None or share.value is None:
        why = "measures.parquet does not say" if share is None else str(share.why)
        sentence = Markup("For how long the patient was upright is not known: {}.{}")
        return sentence.format(why, _transitions(session))
    ledger = session.ledger
    upright = ledger.figure(rows_of(share), Aggregation(column="value"), PERCENT)
    of_what = "of the time" if unknown is not None and unknown.value == 0 else "of the time in which posture is known"
    gap = Markup()
    if unknown is not None and unknown.value:
        seconds = ledger.figure(rows_of(unknown), Aggregation(column="value"), value_form(unknown))
        gap = Markup(" (unknown for {} {})").format(seconds, ledger.link(rows_of(unknown)))
    source = ledger.link(rows_of(share))
    sentence = Markup("The patient was upright in {} {}{} {}.{}")
    return sentence.format(upright, of_what, gap, source, _transitions(session))


def _transitions(session: Session) -> Markup:
    """How often each was seen, which is a lower bound where posture is not known throughout."""
    seen, least = [], "at least " if (session.posture.upright == UNKNOWN).any() else ""
    for kind, words in ((SIT_TO_STAND, "stood up"), (STAND_TO_SIT, "sat down")):
        rows = Rows(EPISODES_FILE, (("kind", kind),))
        count = sum(episode.kind == kind for episode in session.episodes)
        if count:
            form = Form(after=" time" if count == 1 else " times")
            times = session.ledger.figure(rows, Aggregation(column="kind", how="count"), form)
            seen.append(Markup("{} {}{} {}").format(words, least, times, session.ledger.link(rows)))
    return Markup(" The patient {}.").format(Markup(" and ").join(seen)) if seen else Markup()


def _touch(session: Session) -> Markup:
    """Who touched the patient, and in how much of the session that can be known at all."""
    if session.contacts is None:
        return Markup("Whether anybody touched the patient is not known: the folder has no {}.").format(CONTACTS_FILE)
    everywhere = not session.joints.lost.all(axis=1).any()
    touched = _touched_by(session, everywhere) if session.contacts else Markup("Nobody was seen to touch the patient.")
    if everywhere:
        return touched
    found = session.ledger.figure(JOINTS, Aggregation(column="state", how="frames", among=("lost",)), PERCENT)
    return Markup(
        "{} The patient was found in {} of the frames {}: whether anybody touched the patient in the others is not "
        "known."
    ).format(touched, found, session.ledger.link(JOINTS))


def _touched_by(session: Session, everywhere: bool) -> Markup:
    """everywhere: the patient was found in all frames."""
    ledger, contacts = session.ledger, session.contacts or ()
    person = Form(after=" person" if len({c.person for c in contacts}) == 1 else " people")
    part = Form(after=" part" if len({c.part for c in contacts}) == 1 else " parts")
    people = ledger.figure(CONTACTS, Aggregation(column="person", how="distinct"), person)
    parts = ledger.figure(CONTACTS, Aggregation(column="part", how="distinct"), part)
    again = "" if everywhere else ", and so is everybody after the patient was lost"
    return Markup(
        "{} touched the patient, {} of the body in all {}. A person who leaves and comes back is counted again{}."
    ).format(people, parts, ledger.link(CONTACTS), again)


NEVER_FOUND: Final = Markup(
    "<b>The patient was never found.</b> No joint has a position in any frame: there is nothing to read below."
)


def _quality(session: Session) -> Markup:
    ledger = session.ledger
    seen, inferred, lost = (
        ledger.figure(JOINTS, Aggregation(column="state", how="share", among=among), PERCENT)
        for among in (("observed",), INFERRED_STATES, ("lost",))
    )
    reach = Form(times=1000 * COVERAGE, before="± ", after=" mm")
    typical = ledger.figure(JOINTS, Aggregation(column="sigma_m", how="median"), reach)
    return Markup(
        "{} Of all joint positions {} were seen, {} were inferred from the rest of the body and from movement, and {} "
        "are lost {}. A typical position is accurate to {} along each axis, 95 times in 100, by the program's own "
        "estimate.{}{}"
    ).format(_verdict(session), seen, inferred, lost, ledger.link(JOINTS), typical, _weak(session), _problems(session))


def _verdict(session: Session) -> Markup:
    """How much is lost, and how much was seen of what is not: one does not make up for the other."""
    lost = float(session.joints.lost.mean())
    seen = float(seen_shares(session).mean()) / (1.0 - lost)
    sentences = [_lost_verdict(lost), _seen_verdict(seen, whole=lost <= MUCH_LOST)]
    return Markup(" ").join(Markup("<b>{}</b>").format(sentence) for sentence in sentences if sentence)


def _lost_verdict(lost: float) -> str:
    if lost > MOSTLY_LOST:
        return "Most joint positions are lost: what follows describes the rest of the session only."
    return "Part of the joint positions is lost and stays a gap." if lost > MUCH_LOST else ""


def _seen_verdict(seen: float, whole: bool) -> str:
    """whole: hardly anything is lost, so that what is known stands for the session."""
    if seen < SELDOM_SEEN:
        return "Most of what follows is inferred, not seen: do not rely on it without looking at the pictures."
    if seen < USUALLY_SEEN:
        return (
            "The patient was in view most of the time; what was hidden is inferred, and marked."
            if whole
            else "Most of the others were seen; the rest is inferred, and marked."
        )
    return "The patient was in plain view nearly all the time." if whole else "Nearly all others were seen."


def _weak(session: Session) -> str:
    shares = seen_shares(session)
    weak = [named_part(JOINT_NAMES[k]) for k in np.flatnonzero(shares < SELDOM_SEEN)]
    if len(weak) == len(JOINT_NAMES):
        return " No joint was seen in half of the frames."
    return f" Seen in less than half of the frames: {listed(weak)}." if weak else ""


def _problems(session: Session) -> Markup:
    """With a link to the list of them, which only the page of one session has."""
    count = len({drop["frame"] for drop in session.run.get("dropped", [])})
    if not count:
        return Markup()
    where = Markup() if session.ledger.name else Markup(' (<a href="#left-out">which and why</a>)')
    return Markup(" {} had problems{}.").format(counted(count, "frame"), where)
