"""index.html of a batch: every session, what failed, and the measures side by side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final
from urllib.parse import quote

from markupsafe import Markup

from anchorpose.batch.table import DONE, RESULTS_FOLDER, STATES, SessionRow
from anchorpose.report.measure_section import title_of, value_form
from anchorpose.report.page import REPORT_FILE
from anchorpose.results.folder import write_text_whole
from anchorpose.results.records import Measure
from anchorpose.results.uncertainty import NORMAL_95
from anchorpose.results.web_page import render_page

PAGE_FILE: Final = "index.html"
MOST_COMPARED: Final = 300  # sessions with their measures on the page: it stays quick; the tables hold all

UNKNOWN: Final = Markup('<span title="{}">–</span>')


def write_page(out: Path, rows: Sequence[SessionRow], measures: dict[str, tuple[Measure, ...]]) -> Path:
    """Writes index.html. measures: of each session that is done, by its name."""
    counts = Counter(row.state for row in rows)
    compared = [row for row in rows if row.state == DONE][:MOST_COMPARED]
    page = render_page(
        "anchorpose.batch",
        "page.html",
        title=f"{len(rows)} sessions",
        counts=[(state, counts[state]) for state in STATES if counts[state]],
        sessions=[(_name(row), _cells(row)) for row in rows],
        failed=[row for row in rows if row.why],
        measure_titles=list(_titles(compared, measures).values()),
        measures=_measure_rows(compared, measures),
        left_out=counts[DONE] - len(compared),
    )
    write_text_whole(out / PAGE_FILE, page)
    return out / PAGE_FILE


def _name(row: SessionRow) -> Markup:
    if row.state != DONE:
        return Markup("{}").format(row.session)
    return Markup('<a href="{}">{}</a>').format(quote(f"{RESULTS_FOLDER}/{row.session}/{REPORT_FILE}"), row.session)


def _cells(row: SessionRow) -> list[str]:
    shares = (row.seen_share, row.inferred_share, row.lost_share)
    return [
        row.subject,
        row.state,
        _clock(row.length_s),
        "" if row.frames is None else str(row.frames),
        *("" if share is None else f"{100 * share:.1f}" for share in shares),
        _clock(row.work_s),
    ]


def _clock(seconds: float | None) -> str:
    if seconds is None:
        return ""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


Key = tuple[str, str | None, str | None]


def _key(measure: Measure) -> Key:
    return measure.measure, measure.side, measure.part


def _titles(rows: Sequence[SessionRow], measures: dict[str, tuple[Measure, ...]]) -> dict[Key, str]:
    return {_key(one): title_of(one) for row in rows for one in measures[row.session] if one.part is None}


def _measure_rows(
    rows: Sequence[SessionRow], measures: dict[str, tuple[Measure, ...]]
) -> list[tuple[Markup, list[Markup]]]:
    """(session, a cell per measure)."""
    keys = list(_titles(rows, measures))
    found = [{_key(one): one for one in measures[row.session]} for row in rows]
    return [(_name(row), [_value(own.get(key)) for key in keys]) for row, own in zip(rows, found, strict=True)]


def _value(measure: Measure | None) -> Markup:
    if measure is None or measure.value is None:
        return UNKNOWN.format("did not occur" if measure is None else measure.why)
    form = value_form(measure)
    error = Markup("") if measure.sigma is None else Markup(" ± {}").format(form.write(NORMAL_95 * measure.sigma))
    return Markup("{}{}").format(form.write(measure.value), error)
