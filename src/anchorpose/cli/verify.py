"""``anchorpose verify``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from anchorpose.verifying import Fits


def verify(results: Path, recording: Path | None = None, /) -> int:
    """See whether results are as they were written, and of this recording: by the hashes in run.json.

    Says which tables, pictures and files of the recording were changed, who corrected what, and whether program and
    libraries are still the same. The exit code is 0 where every file fits, 1 where one does not.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    recording
        The recording that the results are of; without it, only the results are looked at.
    """
    from anchorpose import verifying

    found = verifying.verify(results, recording)
    _print_files("results", found.results)
    if found.recording is not None:
        _print_files("recording", found.recording)
    for sentence in (*found.program, *found.corrected):
        print(f"{sentence}.")
    print("Every file is as it was." if found.is_right else "Not every file is as it was.")
    return int(not found.is_right)


def _print_files(what: str, files: Mapping[str, Fits]) -> None:
    right = sum(fits.value == "as it was written" for fits in files.values())
    print(f"{what}: {right} of {len(files)} files are as they were.")
    for name, fits in files.items():
        if fits.value != "as it was written":
            print(f"  {name}: {fits.value}")
