"""Which recording has which name in the folder of a batch, over all calls into it: ``batch.json``.

A name is the name of a results folder, so it never passes from one recording to another.
"""

from __future__ import annotations

import hashlib
import json
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from filelock import FileLock

from anchorpose.batch.sessions import Session
from anchorpose.errors import InputError
from anchorpose.recording.document import read_json
from anchorpose.recording.regular_file import LARGEST_IMAGE, open_regular, read_whole
from anchorpose.recording.writable import new_folder
from anchorpose.results.folder import write_text_whole

BATCH_FILE: Final = "batch.json"
LOCK_FILE: Final = ".batch.lock"
FORMAT: Final = "anchorpose-batch"
LONGEST_NAME: Final = (
    100  # bytes: encrypted folders allow 143, and a run adds up to 30, as in .NAME.json.partial-01234567
)
DEVICES: Final = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)  # no file names on Windows
BEGINNING: Final = 2**20  # bytes of a recorder's file: its header and the first images
DAMAGED: Final = "choose another folder for the batch; the results in this one stay as they are"


@dataclass(frozen=True, slots=True)
class NamedRecording:
    """A line of batch.json. recording: its whole path or its address; mark: hash of some of its images, None where it
    has none or they cannot be read."""

    session: str
    recording: str
    subject: str
    mark: str | None

    def is_of(self, other: NamedRecording) -> bool:
        """Whether both are one recording: the same images at the same place, or moved from a place that is gone."""
        same_images = self.mark == other.mark or None in (self.mark, other.mark)
        if self.recording == other.recording:
            return same_images
        return self.mark is not None and self.mark == other.mark and not Path(self.recording).exists()


def open_folder(out: Path, sessions: Sequence[Session]) -> tuple[Session, ...]:
    """Make the folder of a batch, or check that it is one; return the sessions with the names that they have in it.

    Raises InputError where the folder is of something else, a session's name cannot be that of a folder, or a name
    that the user gives belongs to another recording.
    """
    mark = out / BATCH_FILE
    if out.exists() and not out.is_dir():
        raise InputError(out, "is a file", "choose another name for the folder of the batch")
    if not mark.is_file() and out.is_dir() and any(file.name != LOCK_FILE for file in out.iterdir()):
        raise InputError(out, "exists and is not the folder of a batch", "choose another name; nothing was changed")
    inside = [one for one in sessions if one.place is not None and out.resolve().is_relative_to(one.place)]
    if inside:
        raise InputError(out, f"lies inside the recording {inside[0].recording}", "choose a folder outside of it")
    before = _read(mark)
    _named(sessions, before, out)  # what is refused leaves no folder
    with new_folder(out.resolve(), out), FileLock(out / LOCK_FILE):
        before = _read(mark)
        named = _named(sessions, before, out)
        _write(mark, (*(one for one in before if one.session not in {new.session for new in named}), *named))
    return tuple(replace(session, name=one.session) for session, one in zip(sessions, named, strict=True))


def _read(path: Path) -> tuple[NamedRecording, ...]:
    if not path.is_file():
        return ()
    try:
        document = read_json(path)
    except InputError as error:
        raise InputError(path, f"is damaged: it {error.problem}", DAMAGED) from None
    if document.get("format") != FORMAT:
        raise InputError(path, "is not of a batch", "choose another folder")
    return tuple(_entry(path, values) for values in document.get("sessions", ()))


def _entry(path: Path, values: Any) -> NamedRecording:
    try:
        recording = str(values["recording"])
        place = recording if "://" in recording else str(Path(recording).resolve())
        return NamedRecording(str(values["session"]), place, str(values.get("subject", "")), values.get("mark"))
    except (TypeError, KeyError, AttributeError):
        raise InputError(path, "is damaged: an entry under sessions has no session or no recording", DAMAGED) from None


def _write(path: Path, named: Sequence[NamedRecording]) -> None:
    listed = [
        {"session": one.session, "recording": one.recording, "subject": one.subject, "mark": one.mark} for one in named
    ]
    write_text_whole(path, json.dumps({"format": FORMAT, "version": 1, "sessions": listed}, indent=1) + "\n")


def _named(sessions: Sequence[Session], before: Sequence[NamedRecording], out: Path) -> tuple[NamedRecording, ...]:
    """Return an entry per session: named by the user, as in an earlier call, or as short as it can be."""
    own = [NamedRecording("", each.shown, each.subject, _mark_of(each.place)) for each in sessions]
    names = [_given(each) or _earlier(one, before) for each, one in zip(sessions, own, strict=True)]
    taken = {_key(one.session): one for one in before}
    found = dict[int, NamedRecording]()
    for index in sorted(range(len(own)), key=lambda k: names[k] is None):  # names that are given or known come first
        name = names[index] or _free(sessions[index], sessions, taken)
        own[index] = one = replace(own[index], session=name)
        _require_own(one, names[index] is None, tuple(found.values()), taken.get(_key(name)), out)
        found[index] = taken[_key(name)] = one
    return tuple(own)


def _require_own(
    one: NamedRecording, unnamed: bool, others: Sequence[NamedRecording], holder: NamedRecording | None, out: Path
) -> None:
    """Raises InputError where another session of this call has the name, or is of the same recording without a name of
    its own, or the name belongs to another recording."""
    remedy = "name them in a table with a column 'session'"
    if not unnamed:
        remedy = "give them other names in the column 'session'; capitals and the form of accents make no difference"
    for other in others:
        if _key(other.session) == _key(one.session) or (unnamed and other.recording == one.recording):
            raise InputError(other.recording, f"and {one.recording} are both called {other.session}", remedy)
    if holder is not None and not holder.is_of(one):
        problem = f"is called {one.session}, which is the name of another recording, {holder.recording}, in {out}"
        raise InputError(one.recording, problem, "give it another name in the column 'session' of a table")


def _given(session: Session) -> str | None:
    """The name from the user's table; raises InputError where no folder can have it."""
    name = _clean(session.name)
    if len(name.encode()) > LONGEST_NAME:
        problem = f"has a name of {len(name.encode())} bytes ({name[:20]}...)"
        raise InputError(session.shown, problem, f"give it one of {LONGEST_NAME} or less in the column 'session'")
    return name or None


def _earlier(one: NamedRecording, before: Sequence[NamedRecording]) -> str | None:
    found = [each for each in before if each.is_of(one)]
    return max(found, key=lambda each: each.recording == one.recording).session if found else None


def _free(session: Session, sessions: Sequence[Session], taken: dict[str, NamedRecording]) -> str:
    """The name of the recording's folder, with as many of the folders above it as it takes, or with a number."""
    parts = session.parts
    ends = ["-".join(parts[-count:]) for count in range(1, len(parts) + 1)]
    counts = [sum(other.parts[-k:] == parts[-k:] for other in sessions) for k in range(1, len(parts) + 1)]
    alone = [end for end, count in zip(ends, counts, strict=True) if count == 1] or ends[:1]
    names = [_short(_clean(end) or "session") for end in alone]
    numbered = (f"{names[0]}-{number}" for number in range(2, len(taken) + 3))
    return next(name for name in (*names, *numbered) if _key(name) not in taken)


def _clean(name: str) -> str:
    """Letters, digits and . + - _ only."""
    cleaned = re.sub(r"[^\w.+-]+", "_", unicodedata.normalize("NFC", name)).strip(".")
    return f"_{cleaned}" if DEVICES.fullmatch(cleaned) else cleaned


def _short(name: str) -> str:
    """A name that is too long, cut off; a hash of all of it keeps it apart from others."""
    if len(name.encode()) <= LONGEST_NAME:
        return name
    start = name.encode()[: LONGEST_NAME - 12].decode(errors="ignore")
    return f"{start}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def _key(name: str) -> str:
    """What two names have in common that some file systems take for one."""
    return unicodedata.normalize("NFC", name.casefold())


def _mark_of(place: Path | None) -> str | None:
    """A hash of the first, the middle and the last depth image of a recording's first camera, or of the beginning of a
    recorder's file and its size."""
    try:
        if place is None or not place.exists():
            return None
        if place.is_file():
            with open_regular(place) as stream:
                return hashlib.sha256(stream.read(BEGINNING) + str(place.stat().st_size).encode()).hexdigest()
        files = next((found for folder in sorted(place.glob("*/depth")) if (found := sorted(folder.glob("*.png")))), [])
        chosen = [files[k] for k in sorted({0, len(files) // 2, len(files) - 1})] if files else []
        return hashlib.sha256(b"".join(map(_image, chosen))).hexdigest() if chosen else None
    except (OSError, InputError):
        return None


def _image(path: Path) -> bytes:
    return read_whole(path, LARGEST_IMAGE, "copy the image again")
