"""log.jsonl: what made a results folder and what was done with it since, one line each, only ever added to.

Each line holds the hash of itself with the line before, so that a line that is changed, removed or inserted shows. It
is not a signature: all hashes can be computed again, which only a copy of the last one, kept elsewhere, reveals.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from filelock import FileLock
from pydantic import Field, ValidationError

from anchorpose.errors import InputError
from anchorpose.recording.document import Entry, parse_json
from anchorpose.recording.regular_file import read_whole
from anchorpose.results.corrections import Utc
from anchorpose.results.run_record import hash_files
from anchorpose.settings import Unfit
from anchorpose.versions import versions

LOG_FILE: Final = "log.jsonl"
LOCK_FILE: Final = ".log.jsonl.lock"
LARGEST_LOG: Final = 64 * 2**20


class Event(Entry):
    """One line. files: SHA-256 of each file of the results as it was left, None where it was removed."""

    at: Utc
    what: str
    by: str = ""
    anchorpose: str = ""
    files: dict[str, str | None] = Field(default_factory=dict)
    about: dict[str, Any] = Field(default_factory=dict)
    sha256: str

    @property
    def sentence(self) -> str:
        """For people: when, what, by whom, with what."""
        by = f" by {self.by}" if self.by else ""
        about = "".join(f", {key} {value}" for key, value in self.about.items())
        return f"{self.at}: {self.what}{by}, anchorpose {self.anchorpose}{about}"


@dataclass(frozen=True, slots=True)
class Log:
    """The lines in their order; broken: a sentence on each line that does not follow from the one before."""

    events: tuple[Event, ...]
    broken: tuple[str, ...]


def add_event(
    results: Path, what: str, files: Iterable[str] = (), by: str = "", about: dict[str, Any] | None = None
) -> None:
    """Adds a line to the log of a results folder.

    what: the verb; files: those of the results that it wrote or removed; by: who did so, for people. Raises OSError
    where the log cannot be written.
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
    """The log of a results folder, None where it has none; raises InputError where a line is none of a log."""
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
    """The hash that the last line states; empty where it is damaged: what follows then shows as not connected."""
    try:
        return str(parse_json(line)["sha256"])
    except (Unfit, LookupError, TypeError):
        return ""


def _chained(previous: str, line: dict[str, Any]) -> str:
    text = previous + json.dumps(line, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
