"""comparison.html: several sessions of one patient side by side, and which changes are more than the errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from anchorpose.errors import InputError
from anchorpose.report.comparable import differences, require_comparable
from anchorpose.report.comparison_tables import angle_table, change_table
from anchorpose.report.page import page_parts
from anchorpose.report.session import Session, read_session
from anchorpose.report.summary import summary
from anchorpose.report.timeline import short_timeline
from anchorpose.report.words import escape
from anchorpose.results.folder import write_text_whole
from anchorpose.results.web_page import render_page


def write_comparison(folders: Sequence[Path], page: Path, labels: Sequence[str] = ()) -> Path:
    """Writes one page on two or more results folders, in the order given; the first is what others are compared with.

    labels: one a session; by default the name of its recording, or of its folder where two recordings share a name.
    Raises InputError where a folder is unusable or they cannot be compared; nothing is written then.
    """
    if len(folders) < 2:
        raise InputError(page, "needs two or more sessions", "give their results folders in order of time")
    sessions = [read_session(folder, f"s{number}") for number, folder in enumerate(folders, 1)]
    require_comparable(sessions)
    write_text_whole(page, _page(sessions, _labels(sessions, labels)))
    return page


def _labels(sessions: Sequence[Session], labels: Sequence[str]) -> list[str]:
    if labels and len(labels) != len(sessions):
        problem = f"{len(labels)} labels are given for {len(sessions)} sessions"
        raise InputError(sessions[0].folder, problem, "give --label once for each session, in the same order")
    if labels:
        return list(labels)
    names = [session.recording for session in sessions]
    folders = [session.folder.resolve().name for session in sessions]
    return next((told for told in (names, folders) if len(set(told)) == len(told)), [str(s.folder) for s in sessions])


def _page(sessions: Sequence[Session], labels: Sequence[str]) -> str:
    notes = differences(sessions, labels)
    parts = {
        "sessions": "".join(_session(session, label) for session, label in zip(sessions, labels, strict=True)),
        "differences": "".join(f"<li>{escape(note)}</li>" for note in notes)
        or "<li>The sessions were tracked by the same version with the same settings and cameras.</li>",
        "changes": change_table(sessions, labels),
        "angles": angle_table(sessions, labels),
        "first": escape(labels[0]),
    }
    parts["sources"] = "".join(_sources(session, label) for session, label in zip(sessions, labels, strict=True))
    values = {name: Markup(html) for name, html in (parts | page_parts()).items()}
    return render_page("anchorpose.report", "comparison.html", title="Comparison of sessions", **values)


def _session(session: Session, label: str) -> str:
    return (
        f"<section><h3>{escape(label)}</h3><div class='summary'>{summary(session)}</div>"
        f"{short_timeline(session, label)}</section>"
    )


def _sources(session: Session, label: str) -> str:
    return f"<h3>Sources of {escape(label)}</h3>{session.ledger.sources()}"
