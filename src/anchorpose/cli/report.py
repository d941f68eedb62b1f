"""``anchorpose report``."""

from __future__ import annotations

from pathlib import Path


def report(results: Path, /) -> None:
    """Make report.html of a results folder again, from its tables and pictures.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    """
    from anchorpose.results.report import write_report

    print(f"Open {write_report(results)} in a browser.")
