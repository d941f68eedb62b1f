"""Whether a results folder is as it was written, and of the recording that is given with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from anchorpose.errors import InputError
from anchorpose.recording.reader import input_files, open_recording
from anchorpose.results.records import EPISODES_FILE, MEASURES_FILE
from anchorpose.results.run_document import read_run
from anchorpose.results.run_record import RUN_FILE, hash_files, output_files
from anchorpose.results.tables import ANGLES_FILE, POSTURE_FILE, PROCESSED_FILE
from anchorpose.versions import code_digest, versions

MEASURED: Final = frozenset({ANGLES_FILE, POSTURE_FILE, PROCESSED_FILE, EPISODES_FILE, MEASURES_FILE})
"""Tables that 'anchorpose measure' writes again from the joints."""


class Fits(StrEnum):
    """What became of a file or a fact since the run."""

    SAME = "as it was written"
    MEASURED = "written again, as 'anchorpose measure' does"
    CHANGED = "changed"
    MISSING = "missing"
    ADDED = "added"

    @property
    def is_right(self) -> bool:
        """Whether nobody has to look at it."""
        return self in (Fits.SAME, Fits.MEASURED)


@dataclass(frozen=True, slots=True)
class Verified:
    """results, recording: what became of each file, the recording's None where none is given; program: whether version,
    code or libraries differ from today's, as sentences; corrected: who corrected what, as sentences."""

    results: Mapping[str, Fits]
    recording: Mapping[str, Fits] | None
    program: tuple[str, ...]
    corrected: tuple[str, ...]

    @property
    def is_right(self) -> bool:
        """Whether all files are as they were; another version of the program is no fault of the results."""
        return all(fits.is_right for files in (self.results, self.recording or {}) for fits in files.values())


def verify(results: Path, recording: Path | None) -> Verified:
    """Compares every table and picture, and every file of the recording, with the hashes in run.json.

    Raises InputError where run.json cannot be read, or has no hashes because an older version wrote it.
    """
    path = results / RUN_FILE
    run = read_run(path)
    written = run.get("outputs_sha256")
    if not written:
        raise InputError(path, "has no hashes of the tables: an older version wrote it", "track the recording again")
    found = dict(hash_files(output_files(results), results))
    outputs = _compare(written, found)
    for name in MEASURED & outputs.keys():
        if outputs[name] in (Fits.CHANGED, Fits.ADDED):
            outputs[name] = Fits.MEASURED
    return Verified(outputs, _inputs(run, recording), _program(run), _corrections(run))


def _compare(before: Mapping[str, str], now: Mapping[str, str]) -> dict[str, Fits]:
    names = sorted(before.keys() | now.keys())
    return {name: _fits(before.get(name), now.get(name)) for name in names}


def _fits(before: str | None, now: str | None) -> Fits:
    if before is None:
        return Fits.ADDED
    if now is None:
        return Fits.MISSING
    return Fits.SAME if before == now else Fits.CHANGED


def _inputs(run: Mapping[str, Any], recording: Path | None) -> dict[str, Fits] | None:
    """The files of the recording; reference movements are hashed with them, and are not looked for."""
    if recording is None:
        return None
    found = dict(hash_files(input_files(open_recording(recording)), recording))
    motions = {name for name in run["inputs_sha256"] if name.endswith(".npz")}
    return _compare({name: sha for name, sha in run["inputs_sha256"].items() if name not in motions}, found)


def _program(run: Mapping[str, Any]) -> tuple[str, ...]:
    then, now = run.get("versions", {}), versions()
    changed = [
        f"{name} was {then[name]}, is {now[name]}"
        for name in sorted(then)
        if now.get(name, "") != then[name] and name in now
    ]
    if run.get("code") and run["code"] != code_digest():
        changed.insert(0, "the program's code is not the one that made these results")
    return tuple(changed)


def _corrections(run: Mapping[str, Any]) -> tuple[str, ...]:
    """Who corrected what, in the order of the file."""
    given = run.get("corrections")
    if not given:
        return ()
    sentences = []
    if given.get("patient"):
        one = given["patient"]
        sentences.append(f"{one['who']} named the patient in frame {one['frame']} on {one['when'][:10]}")
    counts: dict[tuple[str, str], int] = {}
    for one in given.get("joints", ()):
        counts[one["who"], one["when"][:10]] = counts.get((one["who"], one["when"][:10]), 0) + 1
    sentences += [f"{who} corrected {count} joints on {day}" for (who, day), count in counts.items()]
    sentences += [
        f"{one['who']} marked frames {one['first_frame']} to {one['last_frame']} as unusable on {one['when'][:10]}"
        for one in given.get("unusable", ())
    ]
    return tuple(sentences)
