"""The moments that the patient's body explains least, with what is wrong in each; nothing where all is explained."""

from __future__ import annotations

from typing import Final, NamedTuple

from markupsafe import Markup

from anchorpose.report.ledger import Aggregation, Form, Rows
from anchorpose.report.session import Session
from anchorpose.report.words import listed, named_part
from anchorpose.results.explained import (
    EXPLAINED_FILE,
    PART_NAMES,
    SEEN_PAST,
    UNCOVERED_CM2,
    Moment,
    worst_moments,
)

EXPLAINED: Final = Rows(EXPLAINED_FILE)
PERCENT: Final = Form(times=100.0, after=" %", share=True)

MEANING: Final = (
    "There a limb is probably not where it is reported, or another person's surface was taken for the patient's."
)
BARE: Final = Markup(
    "In {} of the frames in which the patient was found {}, {} cm² or more of the patient's visible surface is covered "
    "by no limb. {}"
)
THROUGH: Final = Markup("At some moments a limb lies where a camera sees something farther away. {}")


class MomentSection(NamedTuple):
    """A sentence, and the worst moments as rows of (time, cells)."""

    sentence: Markup
    rows: list[tuple[Markup, list[Markup]]]


def moment_section(session: Session) -> MomentSection | None:
    """None where the body explains every frame, or where the results do not say."""
    if session.explained is None:
        return None
    moments = worst_moments(session.explained)
    if not moments:
        return None
    return MomentSection(_sentence(session), [_row(session, moment) for moment in moments])


def _sentence(session: Session) -> Markup:
    share = Aggregation(column="uncovered_cm2", how="at least", among=(f"{UNCOVERED_CM2:g}",))
    if not session.ledger.take(EXPLAINED, share):
        return THROUGH.format(MEANING)
    ledger = session.ledger
    return BARE.format(ledger.figure(EXPLAINED, share, PERCENT), ledger.link(EXPLAINED), f"{UNCOVERED_CM2:g}", MEANING)


def _row(session: Session, moment: Moment) -> tuple[Markup, list[Markup]]:
    rows, ledger = Rows(EXPLAINED_FILE, (("frame", str(moment.frame)),)), session.ledger
    time_s = ledger.figure(rows, Aggregation(column="time_s"), Form(decimals=2, after=" s"))
    uncovered = ledger.figure(rows, Aggregation(column="uncovered_cm2"), Form(after=" cm²"))
    through = []
    for part in PART_NAMES:
        share = Aggregation(column=f"{part}_seen_past")
        if (ledger.take(rows, share) or 0.0) >= SEEN_PAST:
            through.append(Markup("{} {}").format(named_part(part), ledger.figure(rows, share, PERCENT)))
    limbs = Markup(listed(through)) if through else Markup("none")
    return time_s, [Markup(moment.frame), uncovered, limbs, ledger.link(rows)]
