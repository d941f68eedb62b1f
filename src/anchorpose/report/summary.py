"""What was recorded and how good it is, in plain words, from the tables alone."""

from __future__ import annotations

import numpy as np

from anchorpose.joints import JOINT_NAMES
from anchorpose.report.ledger import Form, Rows, Taking
from anchorpose.report.measure_section import rows_of, value_form
from anchorpose.report.session import Session
from anchorpose.report.words import COVERAGE, INFERRED_STATES, counted, escape, listed, named_part
from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.records import CONTACTS_FILE, EPISODES_FILE, SIT_TO_STAND, STAND_TO_SIT, Measure
from anchorpose.results.tables import JOINTS_FILE

JOINTS, CONTACTS = Rows(JOINTS_FILE), Rows(CONTACTS_FILE)

PERCENT = Form(times=100.0, after=" %", share=True)

SELDOM_SEEN, USUALLY_SEEN = 0.5, 0.9
"""Shares of the frames. Below the first a joint's curve is more inference than measurement, and is named."""

MUCH_LOST, MOSTLY_LOST = 0.1, 0.5
"""Shares of all joint positions; above the first it is the first thing that a reader has to know."""


def summary(session: Session) -> str:
    """HTML: what was recorded, how much of it can be used, what was done."""
    return "".join(f"<p>{part}</p>" for part in (_recorded(session), _done(session), _quality(session)) if part)


def seen_shares(session: Session) -> np.ndarray:
    """(21,) share of the frames in which each joint was seen."""
    shares: np.ndarray = (session.joints.state_code == 0).mean(axis=0)
    return shares


def _recorded(session: Session) -> str:
    names = [str(camera["name"]) for camera in session.run.get("cameras", [])]
    seconds = session.ledger.figure(*_duration(session), Form(decimals=1, after=" s"))
    frames = session.ledger.figure(
        JOINTS,
        Taking(column="frame", how="distinct"),
        Form(after=" frame" if len(session.joints.frame) == 1 else " frames"),
    )
    seen_by = f", seen by {counted(len(names), 'camera')} ({escape(listed(names))})" if names else ""
    return f"<b>{escape(session.recording)}</b>: {seconds}, {frames}{seen_by}. {session.ledger.link(JOINTS)}"


def _duration(session: Session) -> tuple[Rows, Taking]:
    """As the measures have it, in which the last frame lasts as long as the others."""
    measured = _measure(session, "recorded_time")
    return (
        (JOINTS, Taking(column="time_s", how="extent"))
        if measured is None or measured.value is None
        else (rows_of(measured), Taking(column="value"))
    )


def _measure(session: Session, name: str) -> Measure | None:
    return next((m for m in session.measures if m.measure == name), None)


def _done(session: Session) -> str:
    """Nothing of a patient who was never found: nothing is known of what he did."""
    if session.joints.lost.all():
        return ""
    return f"{_posture(session)} {_touch(session)}"


def _posture(session: Session) -> str:
    """The share that stands in the table of measures, and for how long it does not hold."""
    share, unknown = _measure(session, "upright_share"), _measure(session, "unknown_time")
    if share is None or share.value is None:
        why = "measures.parquet does not say" if share is None else str(share.why)
        return f"For how long the patient was upright is not known: {escape(why)}.{_transitions(session)}"
    upright = session.ledger.figure(rows_of(share), Taking(column="value"), PERCENT)
    of_what = "of the time" if unknown is not None and unknown.value == 0 else "of the time in which posture is known"
    told = f"The patient was upright in {upright} {of_what}"
    if unknown is not None and unknown.value:
        seconds = session.ledger.figure(rows_of(unknown), Taking(column="value"), value_form(unknown))
        told += f" (for {seconds} it could not be told {session.ledger.link(rows_of(unknown))})"
    return f"{told} {session.ledger.link(rows_of(share))}.{_transitions(session)}"


def _transitions(session: Session) -> str:
    """How often was seen, which is the least that there were where posture is not known throughout."""
    told, least = [], "at least " if (session.posture.upright == UNKNOWN).any() else ""
    for kind, words in ((SIT_TO_STAND, "stood up"), (STAND_TO_SIT, "sat down")):
        rows = Rows(EPISODES_FILE, (("kind", kind),))
        count = sum(episode.kind == kind for episode in session.episodes)
        if count:
            form = Form(after=" time" if count == 1 else " times")
            times = session.ledger.figure(rows, Taking(column="kind", how="count"), form)
            told.append(f"{words} {least}{times} {session.ledger.link(rows)}")
    return f" The patient {listed(told)}." if told else ""


def _touch(session: Session) -> str:
    """Who touched the patient, and in how much of the session that can be known at all."""
    if session.contacts is None:
        return f"Whether anybody touched the patient is not known: the folder has no {CONTACTS_FILE}."
    ledger = session.ledger
    everywhere = not session.joints.lost.all(axis=1).any()
    if session.contacts:
        person = Form(after=" person" if len({c.person for c in session.contacts}) == 1 else " people")
        part = Form(after=" part" if len({c.part for c in session.contacts}) == 1 else " parts")
        people = ledger.figure(CONTACTS, Taking(column="person", how="distinct"), person)
        parts = ledger.figure(CONTACTS, Taking(column="part", how="distinct"), part)
        again = "" if everywhere else ", and so is everybody after the patient was lost"
        told = f"{people} touched the patient, {parts} of the body in all {ledger.link(CONTACTS)}. "
        told += f"Who leaves and comes back is counted again{again}."
    else:
        told = "Nobody was seen to touch the patient."
    return told if everywhere else f"{told} {_touch_unknown(session)}"


def _touch_unknown(session: Session) -> str:
    found = session.ledger.figure(JOINTS, Taking(column="state", how="frames", among=("lost",)), PERCENT)
    return (
        f"The patient was found in {found} of the frames {session.ledger.link(JOINTS)}: whether anybody touched "
        "the patient in the others is not known."
    )


def _quality(session: Session) -> str:
    ledger = session.ledger
    if session.joints.lost.all():
        return (
            "<b>The patient was never found.</b> No joint has a position in any frame: there is nothing to read below."
        )
    seen, inferred, lost = (
        ledger.figure(JOINTS, Taking(column="state", how="share", among=among), PERCENT)
        for among in (("observed",), INFERRED_STATES, ("lost",))
    )
    typical = ledger.figure(
        JOINTS, Taking(column="sigma_m", how="median"), Form(times=1000 * COVERAGE, before="± ", after=" mm")
    )
    return (
        f"{_verdict(session)} Of all joint positions {seen} were seen, {inferred} were inferred from the rest of the "
        f"body and from movement, and {lost} are lost {ledger.link(JOINTS)}. A typical position is good to {typical} "
        f"along each axis, 95 times in 100, as far as the program can tell itself.{_weak(session)}{_problems(session)}"
    )  # fmt: skip


def _verdict(session: Session) -> str:
    """How much is lost, and how much was seen of what is not: the one does not make up for the other."""
    lost = float(session.joints.lost.mean())
    seen = float(seen_shares(session).mean()) / (1.0 - lost)
    told = [_lost_verdict(lost), _seen_verdict(seen, whole=lost <= MUCH_LOST)]
    return " ".join(f"<b>{words}</b>" for words in told if words)


def _lost_verdict(lost: float) -> str:
    if lost > MOSTLY_LOST:
        return "Most joint positions are lost: what follows tells of the rest of the session only."
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
    return f" Seen in less than half of the frames: {escape(listed(weak))}." if weak else ""


def _problems(session: Session) -> str:
    """With a link to them on the page of one session, which is the page that lists them."""
    count = len({drop["frame"] for drop in session.run.get("dropped", [])})
    if not count:
        return ""
    where = "" if session.ledger.name else " (<a href='#left-out'>which and why</a>)"
    return f" {counted(count, 'frame')} had problems{where}."
