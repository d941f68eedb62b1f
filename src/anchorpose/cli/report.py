"""``anchorpose report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from anchorpose.cli.console import say
from anchorpose.errors import InputError


def report(
    results: Path,
    /,
    *others: Path,
    out: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    label: Annotated[list[str] | None, Parameter(negative=())] = None,
    reliability: Path | None = None,
    by: str = "",
) -> None:
    """Make report.html of a results folder again, or compare several sessions of one patient on one page.

    One folder: its report.html is made from its tables and pictures. Several folders: one page with their measures side
    by side, which also shows the changes that are larger than the measurement error.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    others
        Results folders of later sessions of the same patient, in order of time.
    out
        The page to write for several sessions, for example comparison.html.
    label
        The name of a session on that page, for example --label before --label after; once for each session.
    reliability
        A table that 'anchorpose reliability' wrote: smaller changes than its MDC95 are marked as not shown.
    by
        Who makes the page of one session again, for the log that 'anchorpose verify' reads: your initials or pseudonym.
    """
    from anchorpose.cli.console import log_event
    from anchorpose.report.comparison import write_comparison
    from anchorpose.report.page import write_report

    if others:
        if out is None:
            remedy = "give the page to write their comparison to, with -o FILE.html"
            raise InputError(results, "is one of several sessions", remedy)
        say(f"Open {write_comparison((results, *others), out, label or (), reliability)} in a browser.")
    elif out is not None or label or reliability is not None:
        raise InputError(
            results,
            "is the only session",
            "give another one to compare it with, or leave out -o, --label and --reliability",
        )
    else:
        page = write_report(results)
        log_event(results, "report", (page.name,), by)
        say(f"Open {page} in a browser.")
