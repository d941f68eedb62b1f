"""``anchorpose verify``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from anchorpose.cli.console import say

if TYPE_CHECKING:
    from collections.abc import Mapping

    from anchorpose.results.verify import Fits


def verify(results: Path, recording: Path | None = None, /) -> int:
    """See whether results are as they were written, and of this recording: by the hashes in run.json and log.jsonl.

    Says which tables, pictures and files of the recording were changed, who corrected what, what was measured and
    exported since and by whom, and whether program and libraries are still the same. The exit code is 0 where every
    file fits, 1 where one does not, and 2 where run.json or the log cannot be read.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    recording
        The recording that the results are of; without it, only the results are looked at.
    """
    from anchorpose.results.verify import verify as verified

    found = verified(results, recording)
    _print_files("results", found.results)
    if found.recording is not None:
        _print_files("recording", found.recording)
    if found.log is None:
        say("There is no log.jsonl: what was done with the results is not known.")
    done = (event.sentence for event in found.log or ())
    for sentence in (*found.broken, *found.program, *found.corrected, *done):
        say(f"{sentence}.")
    say("Every file is as it was." if found.is_right else "Not every file is as it was.")
    return int(not found.is_right)


def _print_files(what: str, files: Mapping[str, Fits]) -> None:
    right = sum(fits.value == "as it was written" for fits in files.values())
    say(f"{what}: {right} of {len(files)} files are as they were.")
    for name, fits in files.items():
        if fits.value != "as it was written":
            say(f"  {name}: {fits.value}")
