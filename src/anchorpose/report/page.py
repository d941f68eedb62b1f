"""report.html: one page that a clinician opens anywhere, made from the tables, run.json and the kept pictures."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Final

from anchorpose.report.angle_section import angle_section
from anchorpose.report.exclusions import exclusions
from anchorpose.report.frame_pictures import frame_pictures
from anchorpose.report.joint_section import joint_section
from anchorpose.report.measure_section import measure_section
from anchorpose.report.provenance import provenance
from anchorpose.report.session import Session, read_session
from anchorpose.report.state_table import state_table
from anchorpose.report.summary import summary
from anchorpose.report.timeline import timeline
from anchorpose.report.words import counted
from anchorpose.results.folder import write_text_whole
from anchorpose.results.web_page import fill_page

REPORT_FILE: Final = "report.html"

DARK: Final = (
    "Upright is dark where all joints that tell it were seen, light where one was inferred; what is not upright "
    "is empty, seen or not, and half a column cannot be told. A contact is light from beginning to end, and dark up to "
    "the share of the touching skin that was seen: an average over the contact, not which of its moments were seen."
)
"""How the rows of posture and contacts are read."""


def write_report(results: Path) -> Path:
    """Writes report.html into a results folder and returns its path; the same folder gives the same bytes.

    Raises InputError where a table or run.json is missing or cannot be used; nothing is written then.
    """
    session = read_session(results)
    write_text_whole(results / REPORT_FILE, _page(session))
    return results / REPORT_FILE


def page_parts() -> dict[str, str]:
    """What the pages of this package have in common: their style, their script and how a timeline is read."""
    folder = resources.files("anchorpose.report")
    files = (("style", "css"), ("script", "js"))
    return {name: folder.joinpath(f"page.{kind}").read_text("utf-8") for name, kind in files} | {"dark": DARK}


def _page(session: Session) -> str:
    parts = {
        "summary": summary(session),
        "timeline": timeline(session),
        "measures": measure_section(session),
        "angles": angle_section(session),
        "states": state_table(session),
        "joints": joint_section(session),
        "pictures": frame_pictures(session),
        "exclusions": exclusions(session),
        "provenance": provenance(session),
        "thinned": _thinned(session),
    }
    parts["sources"] = session.ledger.sources()  # last: all others have told by now what they took
    return fill_page("anchorpose.report", "page.html", f"Stand training: {session.recording}", **parts, **page_parts())


def _thinned(session: Session) -> str:
    if not session.bins.thinned:
        return "Every frame is drawn."
    frames, groups = counted(len(session.joints.frame), "frame"), counted(session.bins.count, "group")
    return (
        f"The {frames} are drawn in {groups} of neighbours, each from its lowest to its highest value, so that peaks "
        "stay (a line runs in the middle, a darker band from the one to the other); all frames are in the tables."
    )
