"""Write comparison.html, which shows several sessions of one patient side by side, and states which changes exceed the
errors of measurement.

A change from a to b exceeds the errors if |b - a| is larger than the smallest detectable change, 1.96 sqrt(sigma_a^2 +
sigma_b^2) (Weir 2005, doi:10.1519/15184.1). If errors of measurement are normally distributed and independent between
the sessions, they alone exceed this limit only 5 times in 100. The limit does not cover how a patient varies from day
to day, so even a larger change may be due to this variation. Limits from ``anchorpose reliability`` cover day-to-day
variation, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Final

import numpy as np
from markupsafe import Markup

from anchorpose.errors import InputError
from anchorpose.recording.writable import check_file, new_folder
from anchorpose.report.comparable import SCATTERING, SCATTERS, differences, require_comparable, time_gap
from anchorpose.report.detectable import Detectable, read_detectable
from anchorpose.report.measure_section import (
    grouped_measures,
    inferred_share,
    title_of,
    value_and_error,
    value_form,
    words_of,
)
from anchorpose.report.motion_section import INFERRED_STATES, angle_figures, state_share
from anchorpose.report.session import Session, read_session
from anchorpose.report.summary import summary
from anchorpose.report.timeline import short_timeline
from anchorpose.report.trend import dates_in, parse_dates, trend_section
from anchorpose.report.words import Form, figure, named_part, render_page
from anchorpose.results.folder import write_text_whole
from anchorpose.results.records import Measure
from anchorpose.results.uncertainty import NORMAL_95

# an existing page is overwritten only if it contains this mark
MARK: Final = '<meta name="generator" content="anchorpose report">'


def write_comparison(
    folders: Sequence[Path],
    page: Path,
    labels: Sequence[str] = (),
    reliability: Path | None = None,
    dates: Sequence[str] = (),
) -> Path:
    """Write one page on two or more results folders, in the order given; each later folder is compared with the first.

    labels: one per session; by default the names of the recordings or, if two recordings share a name, the names of the
    folders or, if two folders share a name, their paths. reliability: a table of ``anchorpose reliability``; its
    minimal detectable changes are used as limits where they exceed the limits computed from the sigmas. dates: one per
    session, such as 2025-03-28, used for trends; by default the labels, if all of them are dates. Raises InputError,
    before a page is written, if a folder is unusable or the sessions cannot be compared.
    """
    if len(folders) < 2:
        raise InputError(page, "needs two or more sessions", "give their results folders in order of time")
    check_file(page, MARK, *folders, reliability)
    days = parse_dates(dates, len(folders), page)
    sessions = [read_session(folder, f"s{number}") for number, folder in enumerate(folders, 1)]
    require_comparable(sessions)
    measures = [measure for session in sessions for measure in session.measures]
    detectable = {} if reliability is None else read_detectable(reliability, measures)
    names = _labels(sessions, labels)
    text = _page(sessions, names, detectable, days or parse_dates(dates_in(names), len(folders), page))
    with new_folder(page.resolve().parent, page):
        write_text_whole(page, text)
    return page


def _labels(sessions: Sequence[Session], labels: Sequence[str]) -> list[str]:
    if labels and len(labels) != len(sessions):
        problem = f"{len(labels)} labels are given for {len(sessions)} sessions"
        raise InputError(sessions[0].folder, problem, "give --label once for each session, in the same order")
    if labels:
        return list(labels)
    recordings = [session.recording for session in sessions]
    folders = [session.folder.resolve().name for session in sessions]
    paths = [str(session.folder) for session in sessions]
    return next((names for names in (recordings, folders) if len(set(names)) == len(names)), paths)


def _page(
    sessions: Sequence[Session], labels: Sequence[str], detectable: Detectable, days: Sequence[date] | None
) -> str:
    named = list(zip(sessions, labels, strict=True))
    return render_page(
        "anchorpose.report",
        "templates/comparison.html",
        title="Comparison of sessions",
        labels=labels,
        repeated=bool(detectable),
        change_titles=["measure", *labels, *(f"change to {label}" for label in labels[1:])],
        angle_titles=["angle", *labels],
        differences=differences(sessions, labels),
        sessions=[(label, summary(session), short_timeline(session, label)) for session, label in named],
        changes=change_groups(sessions, detectable),
        trend=trend_section(sessions, days, detectable),
        angles=angle_rows(sessions),
    )


@dataclass(frozen=True, slots=True)
class Change:
    """The change of a measure between two sessions. difference: later minus first; detectable: the limit above which a
    change exceeds the errors, None if no error is stated.

    repeated: whether detectable comes from repeated sessions (MDC95), not from the stated errors.
    """

    difference: float
    detectable: float | None
    repeated: bool = False

    @property
    def exceeds(self) -> bool | None:
        """Return whether the change is larger than ``detectable``; None if no error is stated."""
        return None if self.detectable is None else abs(self.difference) > self.detectable


def change_between(
    first: Measure, later: Measure, repeated: float | None = None, allowed: float = 0.0
) -> Change | None:
    """Return the change of a measure between two sessions; None if either has no value. repeated: the measure's minimal
    detectable change from repeated sessions (MDC95), in its unit, if known; it is the limit unless the limit from the
    two sigmas is larger. allowed: the change that sessions of different length explain (``time_gap``); it is added to
    the limit.

    Raises ValueError for different measures or units.
    """
    if (first.measure, first.side, first.part, first.unit) != (later.measure, later.side, later.part, later.unit):
        raise ValueError(f"{first} and {later} are not the same measure")
    if first.value is None or later.value is None:
        return None
    difference = later.value - first.value
    # no limit unless both sigmas are known and not 0; a sigma of 0 means that no error was measured
    limit = NORMAL_95 * math.hypot(first.sigma, later.sigma) if first.sigma and later.sigma else None
    if repeated is not None and repeated >= (limit or 0.0):
        return Change(difference, repeated + allowed, repeated=True)
    return Change(difference, None if limit is None else limit + allowed)


Key = tuple[str, str | None, str | None]

VERDICTS: Final[dict[bool | None, tuple[str, str]]] = {
    True: ("more than the errors", "exceeds"),
    False: ("not shown: within the errors", "within"),
    None: ("no error is stated", "untested"),
}
REPEATED_VERDICTS: Final[dict[bool | None, tuple[str, str]]] = {
    True: ("more than the minimal detectable change", "exceeds"),
    False: ("not shown: below the minimal detectable change", "within"),
}


def change_groups(
    sessions: Sequence[Session], detectable: Detectable
) -> dict[str, list[tuple[str, str, list[Markup]]]]:
    """Return, by heading, table rows (title, meaning, cells) that show each measure side by side: for each session a
    cell with the value, then for each later session a cell with the change from the first session. detectable: minimal
    detectable changes, as ``read_detectable`` returns them.

    Measures about one person who touched the patient are left out, since a name such as "person 2" may mean a different
    person in another session.
    """
    found = [{(m.measure, m.side, m.part): m for m in session.measures if m.person is None} for session in sessions]
    groups = grouped_measures(list({key: m for each in found for key, m in each.items()}.values()))
    return {
        heading: [_change_row(sessions, found, m, detectable.get((m.measure, m.side, m.unit))) for m in members]
        for heading, members in groups.items()
    }


def _change_row(
    sessions: Sequence[Session], found: Sequence[dict[Key, Measure]], like: Measure, repeated: float | None
) -> tuple[str, str, list[Markup]]:
    measures = [each.get((like.measure, like.side, like.part)) for each in found]
    values = [_value(measure) for measure in measures]
    changes = [
        _change(measures[0], measure, sessions[0].measures, later.measures, repeated)
        for later, measure in zip(sessions[1:], measures[1:], strict=True)
    ]
    return title_of(like), words_of(like.measure).meaning, [*values, *changes]


def _value(measure: Measure | None) -> Markup:
    if measure is None:
        return UNKNOWN.format("did not occur")
    if measure.value is None:
        return Markup('<i class="why">no value: {}</i>').format(measure.why)
    return Markup("{}<br>{}").format(value_and_error(measure), inferred_share(measure, " % inferred"))


def _change(
    first: Measure | None,
    later: Measure | None,
    firsts: Sequence[Measure],
    laters: Sequence[Measure],
    repeated: float | None,
) -> Markup:
    """Return the table cell of a change. firsts, laters: all measures of the first and of the later session; their time
    spans decide whether the change is tested; repeated: the measure's minimal detectable change from repeated sessions,
    if known.
    """
    if first is None or later is None or first.value is None or later.value is None:
        return UNKNOWN.format("not comparable")
    limit, gap = repeated if later.part is None else None, time_gap(later, firsts, laters)
    change = change_between(first, later, limit, max(abs(first.value), abs(later.value)) * gap.share)
    if change is None:
        return UNKNOWN.format("not comparable")
    unlike = gap.why
    if limit is None and later.measure in SCATTERING:
        unlike = unlike or SCATTERS
    if unlike is not None:
        change = Change(change.difference, None)
    verdicts = REPEATED_VERDICTS if change.repeated else VERDICTS
    words, kind = verdicts[change.exceeds]
    needed = "" if change.detectable is None else f" (± {value_form(later).write(change.detectable)})"
    cell = Markup('<span class="change {}"><b>{}</b><br>{}{}</span>')
    return cell.format(kind, _signed(change, later), f"not tested: {unlike}" if unlike else words, needed)


UNKNOWN: Final = Markup('<span class="unknown">{}</span>')


def _signed(change: Change, measure: Measure) -> str:
    sign = "+" if change.difference > 0 else ""
    arrow = {1.0: "▲ ", -1.0: "▼ "}.get(math.copysign(1.0, change.difference), "") if change.exceeds else ""
    return f"{arrow}{sign}{value_form(measure).write(change.difference)}"


def angle_rows(sessions: Sequence[Session]) -> list[tuple[str, list[Markup]]]:
    """Return rows (name, one cell per session) for the angles that all sessions have: the angle's range, its median,
    and the share of frames in which it was inferred.
    """
    names = [name for name in sessions[0].angles.names if all(name in each.angles.names for each in sessions)]
    return [(named_part(name), [_range(session, name) for session in sessions]) for name in names]


def _range(session: Session, name: str) -> Markup:
    column = session.angles.column(name)
    if np.isnan(session.angles.degrees[:, column]).all():
        return UNKNOWN.format("not known in any frame")
    low, middle, high = angle_figures(session, name)
    inferred = state_share(session.angles.state_code[:, column], *INFERRED_STATES)
    form = Form(times=100.0, after=" % inferred", share=True)
    return Markup("{} to {}, median {}<br>{}").format(low, high, middle, figure(inferred, form))
