"""``anchorpose check``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from anchorpose.cli.console import say, show

if TYPE_CHECKING:
    from collections.abc import Sequence

    from anchorpose.check.material import Finding

COLOURS = ("green", "yellow", "red")


def check(recording: Path, /) -> int:
    """See whether a recording is good enough to track: green, yellow or red, each with what to do.

    Green is as it should be. Yellow: results will be less accurate, or have gaps. Red: results will be wrong or
    missing. Do it before the patient has left: some frames are looked at, which takes less than a minute. The exit
    code is 0 where nothing is red, 1 where something is.

    Parameters
    ----------
    recording
        The folder with recording.json and the depth images of each camera, into which nothing is written; or a file of
        a camera's recorder (see docs/guide/convert.md).
    """
    from anchorpose.check.material import Level
    from anchorpose.check.recording_check import check_recording
    from anchorpose.cli.convert import as_recording

    findings = check_recording(as_recording(recording))
    _print_findings(findings)
    return int(any(finding.level is Level.RED for finding in findings))


def _print_findings(findings: Sequence[Finding]) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table("", "check", "measured", "what to do")
    for finding in sorted(findings, key=lambda one: -one.level):
        word = Text(finding.level.word, style=COLOURS[finding.level])
        table.add_row(word, finding.check, finding.measured, finding.remedy)
    show(table)
    counts = [sum(finding.level == level for finding in findings) for level in range(len(COLOURS))]
    say(", ".join(f"{count} {word}" for count, word in zip(counts, COLOURS, strict=True)) + ".")
