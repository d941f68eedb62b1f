"""Measures and ranges of angles of several sessions, side by side.

Whether a measure changed between two sessions by more than the errors that are stated for it.

|b - a| > 1.96 sqrt(sigma_a^2 + sigma_b^2): the smallest change that errors of measurement alone, normal and independent
between the sessions, would exceed only 5 times in 100 (the smallest detectable change; Weir 2005,
doi:10.1519/15184.1). It knows nothing of how a patient differs from day to day, so that a larger change may still be
none in the patient.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from anchorpose.report.angle_section import RANGE
from anchorpose.report.comparable import unlike_time
from anchorpose.report.ledger import Form, Rows, Taking
from anchorpose.report.measure_section import grouped_measures, rows_of, title_of, value_and_error, value_form, words_of
from anchorpose.report.session import Session
from anchorpose.report.words import COVERAGE, INFERRED_STATES, escape, heading_row, named_part, row, table
from anchorpose.results.records import Measure
from anchorpose.results.tables import ANGLES_FILE


@dataclass(frozen=True, slots=True)
class Change:
    """difference: later minus first; detectable: the least that exceeds the errors, None where no error is stated."""

    difference: float
    detectable: float | None

    @property
    def exceeds(self) -> bool | None:
        """Whether it is more than the errors; None where that cannot be told."""
        return None if self.detectable is None else abs(self.difference) > self.detectable


def change_between(first: Measure, later: Measure) -> Change | None:
    """None where one of them has no value. Raises ValueError for different measures or units."""
    if (first.measure, first.side, first.part, first.unit) != (later.measure, later.side, later.part, later.unit):
        raise ValueError(f"{first} and {later} are not the same measure")
    if first.value is None or later.value is None:
        return None
    difference = later.value - first.value
    if not first.sigma or not later.sigma:  # of no error nothing follows, and an error of 0 is none that was measured
        return Change(difference, None)
    return Change(difference, COVERAGE * math.hypot(first.sigma, later.sigma))


Key = tuple[str, str | None, str | None]

VERDICTS = {
    True: ("more than the errors", "exceeds"),
    False: ("within the errors", "within"),
    None: ("no error is stated", "untested"),
}


def change_table(sessions: Sequence[Session], labels: Sequence[str]) -> str:
    """HTML: a row a measure, a column a session, and what changed since the first.

    Measures of one person are left out: people have no names that last from session to session.
    """
    found = [_by_key(session) for session in sessions]
    groups = grouped_measures(list({key: m for each in found for key, m in each.items()}.values()))
    head = ["measure", *labels, *(f"change to {label}" for label in labels[1:])]
    bodies = "".join(_group(sessions, found, heading, members) for heading, members in groups.items())
    return table("Measures side by side", head, bodies, "measures compared")


def angle_table(sessions: Sequence[Session], labels: Sequence[str]) -> str:
    """HTML: the range of each angle in each session, and how much of it was inferred."""
    names = [name for name in sessions[0].angles.names if all(name in session.angles.names for session in sessions)]
    body = "".join(row(named_part(name), [_range(session, name) for session in sessions]) for name in names)
    return table("Ranges of angles", ["angle", *labels], f"<tbody>{body}</tbody>", "measures compared")


def _by_key(session: Session) -> dict[Key, Measure]:
    return {(m.measure, m.side, m.part): m for m in session.measures if m.person is None}


def _group(
    sessions: Sequence[Session], found: Sequence[dict[Key, Measure]], heading: str, members: Sequence[Measure]
) -> str:
    rows = "".join(_row(sessions, [each.get((m.measure, m.side, m.part)) for each in found], m) for m in members)
    return f"<tbody>{heading_row(heading, 2 * len(sessions))}{rows}</tbody>"


def _row(sessions: Sequence[Session], measures: Sequence[Measure | None], like: Measure) -> str:
    values = [_value(session, measure) for session, measure in zip(sessions, measures, strict=True)]
    changes = [
        _change(measures[0], measure, unlike_time(like, sessions[0].measures, later.measures))
        for later, measure in zip(sessions[1:], measures[1:], strict=True)
    ]
    return row(title_of(like), [*values, *changes], words_of(like.measure).meaning)


def _value(session: Session, measure: Measure | None) -> str:
    if measure is None:
        return "<span class='unknown'>did not occur</span>"
    rows, ledger = rows_of(measure), session.ledger
    if measure.value is None:
        return f"<i class='why'>no value: {escape(measure.why)}</i> {ledger.link(rows)}"
    share = Form(times=100.0, after=" % inferred", share=True)
    inferred = "" if measure.inferred_share is None else ledger.figure(rows, Taking(column="inferred_share"), share)
    return f"{value_and_error(ledger, measure)} {ledger.link(rows)}<br>{inferred}"


def _change(first: Measure | None, later: Measure | None, unlike: str | None) -> str:
    """unlike: why the change is shown but not tested; None where it is tested."""
    change = None if first is None or later is None else change_between(first, later)
    if change is None or later is None:
        return "<span class='unknown'>not comparable</span>"
    if unlike is not None:
        shown = Change(change.difference, None)
        return f"<span class='change untested'><b>{_signed(shown, later)}</b><br>{unlike}</span>"
    words, kind = VERDICTS[change.exceeds]
    return f"<span class='change {kind}'><b>{_signed(change, later)}</b><br>{words}{_needed(change, later)}</span>"


def _signed(change: Change, measure: Measure) -> str:
    form = value_form(measure)
    sign = "+" if change.difference > 0 else ""
    arrow = {1.0: "▲ ", -1.0: "▼ "}.get(math.copysign(1.0, change.difference), "") if change.exceeds else ""
    return f"{arrow}{sign}{form.write(change.difference)}"


def _needed(change: Change, measure: Measure) -> str:
    return "" if change.detectable is None else f" (± {value_form(measure).write(change.detectable)})"


def _range(session: Session, name: str) -> str:
    ledger, rows, degree = session.ledger, Rows(ANGLES_FILE, (("angle", name),)), Form(after="°")
    if ledger.take(rows, Taking(column="degrees", how="median")) is None:
        return f"<span class='unknown'>not known in any frame</span> {ledger.link(rows)}"
    low, middle, high = (ledger.figure(rows, Taking(column="degrees", how=how), degree) for how in RANGE)
    share = Form(times=100.0, after=" % inferred", share=True)
    inferred = ledger.figure(rows, Taking(column="state", how="share", among=INFERRED_STATES), share)
    return f"{low} to {high}, median {middle} {ledger.link(rows)}<br>{inferred}"
