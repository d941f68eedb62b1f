"""Write a summary in plain words, from the tables: what was recorded, how good the data are, and which moments to
check.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from markupsafe import Markup

from anchorpose.joints import JOINT_NAMES, JointState
from anchorpose.report.measure_section import value_form
from anchorpose.report.motion_section import INFERRED_STATES, known_median, state_share
from anchorpose.report.session import Session
from anchorpose.report.words import PERCENT, Form, counted, figure, listed, named_part
from anchorpose.results.explained import PART_NAMES, SEEN_PAST, UNCOVERED_CM2, ExplainedTable, Moment, worst_moments
from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.records import (
    BUCKLE_LEFT,
    BUCKLE_RIGHT,
    CONTACTS_FILE,
    FAILED_STAND,
    RECOVERY_LEFT,
    RECOVERY_RIGHT,
    SIT_TO_STAND,
    STAND_TO_SIT,
    Contact,
    Measure,
    with_equipment,
    with_people,
)
from anchorpose.results.uncertainty import NORMAL_95

SELDOM_SEEN, USUALLY_SEEN = 0.5, 0.9
"""Limits of the share of frames in which a joint is seen. If a joint's share is below the first limit, most of its
curve is inferred, so the summary names the joint. If the mean share of all joints is above the second limit, the
patient was in plain view.
"""

MUCH_LOST, MOSTLY_LOST = 0.1, 0.5
"""Limits of the share of lost joint positions. Above the first limit, the verdict on the data begins with the lost
positions. Above the second limit, the verdict states that most positions are lost.
"""


def summary(session: Session) -> list[Markup]:
    """Return paragraphs: what was recorded, what the patient did, how reliable the joints are."""
    if session.joints.lost.all():  # then it is unknown what the patient did
        return [_recorded(session), NEVER_FOUND]
    return [_recorded(session), Markup(" ").join([_posture(session), _touch(session)]), _quality(session)]


def seen_shares(session: Session) -> np.ndarray:
    """Return (21,) share of the frames in which each joint was seen."""
    shares: np.ndarray = (session.joints.state_code == 0).mean(axis=0)
    return shares


def _recorded(session: Session) -> Markup:
    names = [str(camera["name"]) for camera in session.run.get("cameras", [])]
    frame_form = Form(after=" frame" if len(session.joints.frame) == 1 else " frames")
    return Markup("<b>{}</b>: {}, {}{}.").format(
        session.recording,
        figure(_duration_s(session), Form(decimals=1, after=" s")),
        figure(len(session.joints.frame), frame_form),
        f", seen by {counted(len(names), 'camera')} ({listed(names)})" if names else "",
    )


def _duration_s(session: Session) -> float:
    """Return the duration of the recording in s, as the measures define it: the last frame counts as lasting as long as
    a usual frame. If this measure has no value, return the time from the first frame to the last.
    """
    measured = _measure(session, "recorded_time")
    if measured is None or measured.value is None:
        return float(np.ptp(session.joints.time_s))
    return measured.value


def _measure(session: Session, name: str) -> Measure | None:
    return next((m for m in session.measures if m.measure == name), None)


def _posture(session: Session) -> Markup:
    """Return a sentence on the share of time upright, as in the table of measures, and on the time of unknown
    posture.
    """
    share, unknown = _measure(session, "upright_share"), _measure(session, "unknown_time")
    if share is None or share.value is None:
        why = "measures.parquet does not say" if share is None else str(share.why)
        sentence = Markup("For how long the patient was upright is not known: {}.{}")
        return sentence.format(why, _transitions(session))
    of_what = "of the time" if unknown is not None and unknown.value == 0 else "of the time in which posture is known"
    gap = Markup()
    if unknown is not None and unknown.value:
        gap = Markup(" (unknown for {})").format(figure(unknown.value, value_form(unknown)))
    sentence = Markup("The patient was upright in {} {}{}.{}")
    return sentence.format(figure(share.value, PERCENT), of_what, gap, _transitions(session))


def _transitions(session: Session) -> Markup:
    """Return sentences on how often the patient stood up and sat down ("at least" if the posture is unknown in any
    frame), and which events were seen.
    """
    seen, least = [], "at least " if (session.posture.upright == UNKNOWN).any() else ""
    for kind, words in ((SIT_TO_STAND, "stood up"), (STAND_TO_SIT, "sat down")):
        count = sum(episode.kind == kind for episode in session.episodes)
        if count:
            form = Form(after=" time" if count == 1 else " times")
            seen.append(Markup("{} {}{}").format(words, least, figure(count, form)))
    moves = Markup(" The patient {}.").format(Markup(" and ").join(seen)) if seen else Markup()
    return moves + _events(session)


def _events(session: Session) -> Markup:
    """Return a sentence on the events that were seen; empty if no event was seen, since unseen events may have
    occurred.
    """
    words = (
        ("knee buckle", "knee buckles", (BUCKLE_LEFT, BUCKLE_RIGHT)),
        ("failed stand", "failed stands", (FAILED_STAND,)),
        ("recovery step", "recovery steps", (RECOVERY_LEFT, RECOVERY_RIGHT)),
    )
    counts = [(sum(each.kind in kinds for each in session.episodes), single, many) for single, many, kinds in words]
    seen = [Markup("{} {}").format(figure(n, Form()), single if n == 1 else many) for n, single, many in counts if n]
    return Markup(" Events seen: {}.").format(Markup(", ").join(seen)) if seen else Markup()


def _touch(session: Session) -> Markup:
    """Return a sentence on who touched the patient, and for how much of the session this is known."""
    if session.contacts is None:
        return Markup("Whether anybody touched the patient is not known: the folder has no {}.").format(CONTACTS_FILE)
    lost = session.joints.lost.all(axis=1)
    everywhere = not lost.any()
    people, held = with_people(session.contacts), with_equipment(session.contacts)
    touched = _touched_by(people, everywhere) if people else Markup("Nobody was seen to touch the patient.")
    touched += _rested(held) if held else Markup()
    if everywhere:
        return touched
    return Markup(
        "{} The patient was found in {} of the frames: whether anybody touched the patient in the others is not known."
    ).format(touched, figure(float(1.0 - lost.mean()), PERCENT))


def _rested(contacts: Sequence[Contact]) -> Markup:
    parts = len({contact.part for contact in contacts})
    form = Form(after=" part of the body was" if parts == 1 else " parts of the body were")
    return Markup(" {} in contact with the equipment.").format(figure(parts, form))


def _touched_by(contacts: Sequence[Contact], everywhere: bool) -> Markup:
    """Return a text on who touched the patient. everywhere: whether the patient was found in all frames."""
    people, parts = len({c.person for c in contacts}), len({c.part for c in contacts})
    again = "" if everywhere else ", and so is everybody after the patient was lost"
    return Markup(
        "{} touched the patient, {} of the body in all. A person who leaves and comes back is counted again{}."
    ).format(
        figure(people, Form(after=" person" if people == 1 else " people")),
        figure(parts, Form(after=" part" if parts == 1 else " parts")),
        again,
    )


NEVER_FOUND: Final = Markup(
    "<b>The patient was never found.</b> No joint has a position in any frame: there is nothing to read below."
)


def _quality(session: Session) -> Markup:
    seen, inferred, lost = (
        figure(state_share(session.joints.state_code, *states), PERCENT)
        for states in ((JointState.OBSERVED,), INFERRED_STATES, (JointState.LOST,))
    )
    reach = Form(times=1000 * NORMAL_95, before="± ", after=" mm")
    typical = figure(known_median(session.joints.sigma_m), reach)
    return Markup(
        "{} Of all joint positions {} were seen, {} were inferred from the rest of the body and from movement, and {} "
        "are lost. A typical position has {} along each axis (1.96 sigma), by the program's own estimate.{}{}"
    ).format(_verdict(session), seen, inferred, lost, typical, _weak(session), _problems(session))


def _verdict(session: Session) -> Markup:
    """Return two separate verdicts: how many joint positions are lost, and how many of the remaining positions were
    seen.
    """
    lost = float(session.joints.lost.mean())
    seen = float(seen_shares(session).mean()) / (1.0 - lost)
    sentences = [_lost_verdict(lost), _seen_verdict(seen, whole=lost <= MUCH_LOST)]
    return Markup(" ").join(Markup("<b>{}</b>").format(sentence) for sentence in sentences if sentence)


def _lost_verdict(lost: float) -> str:
    if lost > MOSTLY_LOST:
        return "Most joint positions are lost: what follows describes the rest of the session only."
    return "Part of the joint positions is lost and stays a gap." if lost > MUCH_LOST else ""


def _seen_verdict(seen: float, whole: bool) -> str:
    """Return a verdict on the seen joints. whole: True if so few positions are lost that the remaining ones represent
    the whole session.
    """
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
    """Return a sentence on the number of frames with problems. On a page of a single session, which lists the problems,
    it has a link to the list.
    """
    count = len({drop["frame"] for drop in session.run.get("dropped", [])})
    if not count:
        return Markup()
    where = Markup() if session.name else Markup(' (<a href="#left-out">which and why</a>)')
    return Markup(" {} had problems{}.").format(counted(count, "frame"), where)


MEANING: Final = (
    "There a limb is probably not where it is reported, or another person's surface was taken for the patient's."
)
BARE: Final = Markup(
    "In {} of the frames in which the patient was found, {} cm² or more of the patient's visible surface is covered by "
    "no limb. {}"
)
THROUGH: Final = Markup("At some moments a limb lies where a camera sees something farther away. {}")


class MomentSection(NamedTuple):
    """The content of the section on moments at which body and depth images disagree: a sentence, and the worst moments
    as table rows (time, cells).
    """

    sentence: Markup
    rows: list[tuple[Markup, list[Markup]]]


def moment_section(session: Session) -> MomentSection | None:
    """Return the moments at which the fitted body and the depth images disagree most; None if they disagree in no
    frame, or if the folder has no table of their disagreement.
    """
    table = session.explained
    moments = () if table is None else worst_moments(table)
    if table is None or not moments:
        return None
    area_cm2 = table.uncovered_cm2[np.isfinite(table.uncovered_cm2)]
    share = float((area_cm2 >= UNCOVERED_CM2).mean()) if len(area_cm2) else 0.0
    limit = f"{UNCOVERED_CM2:g}"
    sentence = BARE.format(figure(share, PERCENT), limit, MEANING) if share else THROUGH.format(MEANING)
    return MomentSection(sentence, [_moment_row(table, moment) for moment in moments])


def _moment_row(table: ExplainedTable, moment: Moment) -> tuple[Markup, list[Markup]]:
    row = int(np.flatnonzero(table.frame == moment.frame)[0])
    through = [
        Markup("{} {}").format(named_part(part), figure(share, PERCENT))
        for part, share in zip(PART_NAMES, table.seen_past[row].tolist(), strict=True)
        if share >= SEEN_PAST
    ]
    limbs = Markup(listed(through)) if through else Markup("none")
    uncovered = figure(float(table.uncovered_cm2[row]), Form(after=" cm²"))
    return figure(moment.time_s, Form(decimals=2, after=" s")), [Markup(moment.frame), uncovered, limbs]
