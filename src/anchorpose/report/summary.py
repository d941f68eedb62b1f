"""What was recorded and how good it is, in plain words, from the tables alone."""

from __future__ import annotations

import numpy as np

from anchorpose.joints import JOINT_NAMES
from anchorpose.report.ledger import Form, Rows, Taking
from anchorpose.report.measure_section import rows_of
from anchorpose.report.session import Session
from anchorpose.report.words import COVERAGE, INFERRED_STATES, counted, escape, listed, named_part
from anchorpose.results.contacts import CONTACTS_FILE
from anchorpose.results.episodes import EPISODES_FILE, SIT_TO_STAND, STAND_TO_SIT
from anchorpose.results.posture import POSTURE_FILE
from anchorpose.results.tables import JOINTS_FILE

JOINTS, CONTACTS, POSTURE = Rows(JOINTS_FILE), Rows(CONTACTS_FILE), Rows(POSTURE_FILE)

PERCENT = Form(times=100.0, after=" %", share=True)

SELDOM_SEEN, USUALLY_SEEN = 0.5, 0.9
"""Shares of the frames. Below the first a joint's curve is more inference than measurement, and is named."""


def summary(session: Session) -> str:
    """HTML: what was recorded, how much of it can be used, what was done."""
    return "".join(f"<p>{part}</p>" for part in (_recorded(session), _done(session), _quality(session)) if part)


def seen_shares(session: Session) -> np.ndarray:
    """(21,) share of the frames in which each joint was seen."""
    shares: np.ndarray = (session.joints.severity == 0).mean(axis=0)
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
    measured = next((m for m in session.measures if m.measure == "recorded_time" and m.value is not None), None)
    return (
        (JOINTS, Taking(column="time_s", how="extent"))
        if measured is None
        else (rows_of(measured), Taking(column="value"))
    )


def _done(session: Session) -> str:
    if session.joints.lost.all():
        return ""
    ledger, sentences = session.ledger, []
    upright = ledger.figure(POSTURE, Taking(column="upright", how="share", among=("true",)), PERCENT)
    moved = _transitions(session)
    sentences.append(f"The patient was upright in {upright} of the frames {ledger.link(POSTURE)}{moved}.")
    if session.contacts:
        person = Form(after=" person" if len({c.person for c in session.contacts}) == 1 else " people")
        part = Form(after=" part" if len({c.part for c in session.contacts}) == 1 else " parts")
        people = ledger.figure(CONTACTS, Taking(column="person", how="distinct"), person)
        parts = ledger.figure(CONTACTS, Taking(column="part", how="distinct"), part)
        sentences.append(f"{people} touched the patient, {parts} of the body in all {ledger.link(CONTACTS)}.")
        sentences.append("Who leaves and comes back is counted again.")
    else:
        sentences.append("Nobody was seen to touch the patient.")
    return " ".join(sentences)


def _transitions(session: Session) -> str:
    told = []
    for kind, words in ((SIT_TO_STAND, "stood up"), (STAND_TO_SIT, "sat down")):
        rows = Rows(EPISODES_FILE, (("kind", kind),))
        count = sum(episode.kind == kind for episode in session.episodes)
        if count:
            form = Form(after=" time" if count == 1 else " times")
            times = session.ledger.figure(rows, Taking(column="kind", how="count"), form)
            told.append(f"{words} {times} {session.ledger.link(rows)}")
    return f" and {listed(told)}" if told else ""


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
    share = float(seen_shares(session).mean())
    if share >= USUALLY_SEEN:
        return "<b>The patient was in plain view nearly all the time.</b>"
    if share >= SELDOM_SEEN:
        return "<b>The patient was in view most of the time; what was hidden is inferred, and marked.</b>"
    return "<b>Most of what follows is inferred, not seen: do not rely on it without looking at the pictures.</b>"


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
