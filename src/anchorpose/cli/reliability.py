"""``anchorpose reliability``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from anchorpose.cli.console import show


def reliability(sessions: Path, /, *, out: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None) -> None:
    """How well measures repeat from session to session, and how large a change must be to mean something.

    For every measure: intraclass correlations ICC(2,1) and ICC(3,1) with intervals, standard error of measurement
    (SEM), and minimal detectable change (MDC95). Needs: pip install 'anchorpose[reliability]'.

    Parameters
    ----------
    sessions
        A CSV with the columns subject, session (or rater, or device) and results (a results folder, relative to this
        file); or, in place of results, measure and value.
    out
        Write all figures to this CSV file as well; 'anchorpose report --reliability' reads it.
    """
    from rich.table import Table

    from anchorpose.agreement.reliability import reliability_text, session_reliability
    from anchorpose.results.folder import write_text_whole

    rows = session_reliability(sessions)
    if out is not None:
        write_text_whole(out, reliability_text(rows))
    table = Table("measure", "n", "ICC(2,1)", "ICC(3,1)", "SEM", "MDC95", "unit", "why not")
    for row in rows:
        name = row.measure if row.side is None else f"{row.measure}, {row.side}"
        cells = [
            "–" if value is None else f"{value:.2f} ({low:.2f} to {high:.2f})"
            for value, low, high in (
                (row.icc_2_1, row.icc_2_1_low, row.icc_2_1_high),
                (row.icc_3_1, row.icc_3_1_low, row.icc_3_1_high),
            )
        ]
        errors = ["–" if value is None else f"{value:.3g}" for value in (row.sem, row.mdc95)]
        table.add_row(name, f"{row.subjects} × {row.repeats}", *cells, *errors, row.unit, row.why or "")
    show(table)
