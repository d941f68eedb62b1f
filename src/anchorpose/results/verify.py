"""Check whether a results folder is unchanged since it was written, and whether it comes from the given recording.

log.jsonl has one line for the command that made the folder, and one line for everything done with the folder later;
lines are only added. Each line holds a hash of itself and of the previous line, so a line that was changed, removed or
inserted is detected. The hashes are not a signature: whoever changes the log can compute all of them again. Only a copy
of the last hash, kept elsewhere, would reveal that all hashes were computed again.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from filelock import FileLock
from pydantic import Field, ValidationError

from anchorpose.errors import InputError
from anchorpose.recording.document import Entry, parse_json
from anchorpose.recording.events import GIVEN
from anchorpose.recording.reader import input_files, open_recording
from anchorpose.recording.regular_file import is_there, read_whole
from anchorpose.results.corrections import Utc
from anchorpose.results.parquet import MEASURE_AGAIN
from anchorpose.results.records import EPISODES_FILE, MEASURES_FILE
from anchorpose.results.revolute_joints import AXES_FILE
from anchorpose.results.run_record import RUN_FILE, hash_files, output_files, read_run
from anchorpose.results.tables import ANGLES_FILE, POSTURE_FILE, PROCESSED_FILE
from anchorpose.results.trial_table import INTERVALS_FILE, TRIALS_FILE
from anchorpose.settings import Unfit
from anchorpose.versions import code_digest, versions

LOG_FILE: Final = "log.jsonl"
LOCK_FILE: Final = ".log.jsonl.lock"
LARGEST_LOG: Final = 64 * 2**20  # bytes, maximum size of the log


class Event(Entry):
    """One line of the log, about one command. files: SHA-256 of each file that the command wrote, None for a file that
    it removed.
    """

    at: Utc
    what: str
    by: str = ""
    anchorpose: str = ""
    files: dict[str, str | None] = Field(default_factory=dict)
    about: dict[str, Any] = Field(default_factory=dict)
    sha256: str

    @property
    def sentence(self) -> str:
        """Return the log entry as a sentence for people: time, command, author, version, and details in ``about``."""
        by = f" by {self.by}" if self.by else ""
        about = "".join(f", {key} {value}" for key, value in self.about.items())
        return f"{self.at}: {self.what}{by}, anchorpose {self.anchorpose}{about}"


@dataclass(frozen=True, slots=True)
class Log:
    """The lines of a log in their order. broken: one sentence for each line whose stated hash is not the hash of this
    line and the previous line.
    """

    events: tuple[Event, ...]
    broken: tuple[str, ...]


def add_event(
    results: Path, what: str, files: Iterable[str] = (), by: str = "", about: dict[str, Any] | None = None
) -> None:
    """Add a line to the log of a results folder.

    what: the command; files: files of the results that it wrote or removed; by: the person or program that did it, as
    text for readers. Raises OSError if the log cannot be written.
    """
    names = sorted(files)
    hashes = dict(hash_files([results / name for name in names if (results / name).is_file()], results))
    line = {
        "at": datetime.now(UTC).isoformat(timespec="seconds"),
        "what": what,
        "by": by,
        "anchorpose": versions()["anchorpose"],
        "files": {name: hashes.get(name) for name in names},
        "about": about or {},
    }
    with FileLock(results / LOCK_FILE):
        path = results / LOG_FILE
        before = _lines(path)
        text = json.dumps(line | {"sha256": _chained(_hash_in(before[-1]) if before else "", line)}, ensure_ascii=False)
        with path.open("ab") as file:
            file.write(text.encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())


def read_log(results: Path) -> Log | None:
    """Return the log of a results folder, None if the folder has no log; raises InputError if a line is not a log
    entry.
    """
    path, events, broken, previous = results / LOG_FILE, list[Event](), list[str](), ""
    if not path.exists():
        return None
    for number, text in enumerate(_lines(path), 1):
        try:
            line = parse_json(text)
            event = Event.model_validate(line)
        except (Unfit, ValidationError):
            raise InputError(path, f"line {number} is not an entry of a log", _REMEDY) from None
        stated = line.pop("sha256")
        if stated != _chained(previous, line):
            broken.append(f"{LOG_FILE}: line {number} was changed, or lines before it were removed or inserted")
        events.append(event)
        previous = stated
    return Log(tuple(events), tuple(broken))


_REMEDY: Final = "get an untouched copy, or track the recording again"


def _lines(path: Path) -> list[bytes]:
    if not path.exists():
        return []
    return [line for line in read_whole(path, LARGEST_LOG, _REMEDY).split(b"\n") if line]


def _hash_in(line: bytes) -> str:
    """Return the hash that a line states. For a damaged line, return an empty text, so that the next line is reported
    as broken, too.
    """
    try:
        return str(parse_json(line)["sha256"])
    except (Unfit, LookupError, TypeError):
        return ""


def _chained(previous: str, line: dict[str, Any]) -> str:
    text = previous + json.dumps(line, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


MEASURED: Final = frozenset(
    {ANGLES_FILE, AXES_FILE, POSTURE_FILE, PROCESSED_FILE, EPISODES_FILE, MEASURES_FILE, TRIALS_FILE, INTERVALS_FILE}
)
"""Tables that 'anchorpose measure' writes again from the joints. The command removes the table of processed angles if
no processing is chosen.
"""


def require_own(results: Path, files: Iterable[str], run: Mapping[str, Any] | None = None) -> None:
    """Raise InputError if a file does not have the hash that the folder's log or run.json states.

    run: the content of run.json if it was already read. Files without a stated hash, as in older results, are accepted.
    """
    known = _known(results, run)
    there = [results / name for name in files if name in known and (results / name).is_file()]
    for name, digest in hash_files(there, results):
        if digest != known[name]:
            remedy = MEASURE_AGAIN if name in MEASURED else "copy that folder again, or track the recording again"
            problem = (
                "is not the table that was written into this folder: its hash is another than in run.json or the log"
            )
            raise InputError(results / name, problem, remedy)


def _known(results: Path, run: Mapping[str, Any] | None) -> dict[str, str]:
    """Return the hash of each file as it was last written. For tables that were measured again, the log states newer
    hashes than run.json.
    """
    if run is None:
        run = read_run(results / RUN_FILE) if is_there(results / RUN_FILE) else {}
    log = read_log(results) if is_there(results / LOG_FILE) else None
    return _last_written(run.get("outputs_sha256", {}), log or Log((), ()))


def _last_written(written: Mapping[str, str], log: Log) -> dict[str, str]:
    """Return the last hash of each file that run.json or the log states, without files that were removed."""
    logged: dict[str, str | None] = dict(written)
    for event in log.events:
        logged |= event.files
    return {name: digest for name, digest in logged.items() if digest is not None}


class Fits(StrEnum):
    """The state of a file of the results or the recording, compared with its state when the results were made."""

    SAME = "as it was written"
    MEASURED = "written again, as 'anchorpose measure' does"
    CHANGED = "changed"
    MISSING = "missing"
    ADDED = "added"

    @property
    def is_right(self) -> bool:
        """Return whether a file in this state counts as right: it is as it was written, or was measured again."""
        return self in (Fits.SAME, Fits.MEASURED)


@dataclass(frozen=True, slots=True)
class Verified:
    """The outcome of the check. results, recording: the state of each file; recording is None if none is given.
    program: sentences on each difference between the run's version, code and libraries and the present ones. corrected:
    sentences on the corrections and their authors. log: entries of the log. broken: sentences on faults of the log.
    """

    results: Mapping[str, Fits]
    recording: Mapping[str, Fits] | None
    program: tuple[str, ...]
    corrected: tuple[str, ...]
    log: tuple[Event, ...]
    broken: tuple[str, ...]

    @property
    def is_right(self) -> bool:
        """Return whether all files are as they were written or were measured again, and the log has no faults. Another
        version of the program does not count as a fault.
        """
        files = (*self.results.values(), *(self.recording or {}).values())
        return not self.broken and all(fits.is_right for fits in files)


def verify(results: Path, recording: Path | None) -> Verified:
    """Compare every table and picture, and every file of the recording if given, with the hashes in run.json and the
    log.

    Raises InputError if run.json or a line of the log cannot be read, or run.json has no hashes because an older
    version wrote it.
    """
    path = results / RUN_FILE
    run = read_run(path)
    written = run.get("outputs_sha256")
    if not written:
        raise InputError(path, "has no hashes of the tables: an older version wrote it", "track the recording again")
    log = read_log(results) or Log((), ())
    gone = () if log.events else (f"{LOG_FILE}: is missing or empty, so what was done with the results is not known",)
    outputs, broken = _by_log(results, written, log), (*log.broken, *gone)
    return Verified(outputs, _inputs(run, recording), _program(run), _corrections(run), log.events, broken)


def _by_log(results: Path, written: Mapping[str, str], log: Log) -> dict[str, Fits]:
    """Compare each file with the last log entry about it. Exported files that are missing are left out, since users
    move such files.
    """
    logged = {name: (event.what, digest) for event in log.events for name, digest in event.files.items()}
    wanted = _last_written(written, log)
    outputs = _compare(wanted, _hashes(results, wanted))
    for name, (what, _) in logged.items():
        if what == "export" and outputs.get(name) is Fits.MISSING:
            del outputs[name]
        elif what == "measure" and outputs.get(name) is Fits.SAME:
            outputs[name] = Fits.MEASURED
    return outputs


def _hashes(results: Path, wanted: Iterable[str]) -> dict[str, str]:
    """Return the hashes of all tables and pictures, and of the files in ``wanted`` that lie inside the folder;
    ``wanted`` files outside of the folder, which a log may name, are left out.
    """
    inside = [results / name for name in wanted if (results / name).resolve().is_relative_to(results.resolve())]
    files = {*output_files(results), *(path for path in inside if path.is_file())}
    return dict(hash_files(sorted(files), results))


def _compare(before: Mapping[str, str], now: Mapping[str, str]) -> dict[str, Fits]:
    changed = {name: Fits.SAME if before[name] == now[name] else Fits.CHANGED for name in before.keys() & now.keys()}
    one_side = {name: Fits.ADDED if name in now else Fits.MISSING for name in before.keys() ^ now.keys()}
    return dict(sorted((changed | one_side).items()))


def _inputs(run: Mapping[str, Any], recording: Path | None) -> dict[str, Fits] | None:
    """Return the states of the recording's files. Reference movements and events from outside the recording are left
    out, although run.json lists them too.
    """
    if recording is None:
        return None
    found = dict(hash_files(input_files(open_recording(recording)), recording))
    hashes = run["inputs_sha256"].items()
    own = {name: sha for name, sha in hashes if not name.endswith(".npz") and not name.startswith(GIVEN)}
    return _compare(own, found)


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
    """Return sentences on who corrected what: who named the patient, who corrected how many joints on a day, and who
    marked frames as unusable.
    """
    given = run.get("corrections")
    if not given:
        return ()
    patient = [given["patient"]] if given.get("patient") else []
    counts = Counter((one["who"], one["when"][:10]) for one in given.get("joints", ()))
    return (
        *(f"{one['who']} named the patient in frame {one['frame']} on {one['when'][:10]}" for one in patient),
        *(f"{who} corrected {count} joints on {day}" for (who, day), count in counts.items()),
        *(
            f"{one['who']} marked frames {one['first_frame']} to {one['last_frame']} as unusable on {one['when'][:10]}"
            for one in given.get("unusable", ())
        ),
    )
