"""Find the sessions of a batch (the recordings to track), and name the results folder of each.

The user lists recordings one by one, by folder, by pattern, or in a table with one row per recording. ``batch.json`` in
the folder of a batch stores the session name of each recording for later calls, so that a name is never used for
another recording.
"""

from __future__ import annotations

import hashlib
import json
import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from glob import glob, has_magic
from pathlib import Path
from typing import Any, Final, Literal

from filelock import FileLock

from anchorpose.cli.track_verbs import TrackOptions
from anchorpose.errors import InputError, is_utf8, without_password
from anchorpose.options import MOST_FRAMES, plain_number
from anchorpose.recording.document import Entry, Version, read_document, read_rows, require_distinct
from anchorpose.recording.recording_file import RECORDING_FILE
from anchorpose.recording.regular_file import LARGEST_IMAGE, open_regular, read_whole
from anchorpose.recording.writable import new_folder
from anchorpose.remote import is_address, parts_of
from anchorpose.results.folder import write_text_whole

TABLE_ENDING: Final = ".csv"
FILES: Final = ("calibration", "corrections", "events", "motions", "config")
NUMBERS: Final = {"height": float, "start": int, "stop": int}
YES_OR_NO: Final = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False}
SETTINGS: Final = tuple(
    each.name for each in fields(TrackOptions) if each.name not in ("overwrite", "resume", "threads")
)
COLUMNS: Final = ("recording", "session", "subject", *SETTINGS)


@dataclass(frozen=True, slots=True)
class Session:
    """A recording to track, given by a path or an address. name: name of its results folder; subject: the patient's
    name in the user's table; options: options of ``track`` for this recording.
    """

    recording: Path | str
    name: str = ""
    subject: str = ""
    options: TrackOptions = field(default_factory=TrackOptions)

    @property
    def place(self) -> Path | None:
        """Return the absolute path of the recording; None if the recording is at an address."""
        return None if isinstance(self.recording, str) else self.recording.resolve()

    @property
    def shown(self) -> str:
        """Return the absolute path of the recording, or its address without the password."""
        return without_password(self.recording) if isinstance(self.recording, str) else str(self.place)

    @property
    def parts(self) -> tuple[str, ...]:
        """Return the names of all folders above the recording, then the recording's own name."""
        if isinstance(self.recording, str):
            return parts_of(self.recording)
        path = self.recording.resolve()
        return tuple(part for part in path.parts if part != path.anchor)

    def absolute(self) -> Session:
        """Return the session with absolute paths, for a worker that runs in another folder."""
        paths = {name: getattr(self.options, name) for name in FILES}
        known: dict[str, Any] = {name: path.resolve() for name, path in paths.items() if path is not None}
        options = replace(self.options, **known)
        return replace(self, recording=self.place or self.recording, options=options)


def find_sessions(given: Sequence[str], options: TrackOptions) -> tuple[Session, ...]:
    """Find the sessions that a user lists, in the order given. At this stage, only sessions from a table can have a
    name.

    given: recordings (folders, or files of a recorder), folders that contain recordings, addresses, patterns such as
    ``clinic/*/recording``, and tables (``.csv``). options: options of all sessions; a row of a table overrides them.
    Raises InputError if nothing exists at a given path or pattern, or a table cannot be used.
    """
    found = [session for text in given for session in _sessions_of(text, options)]
    for session in found:
        if not is_utf8(str(session.recording)):
            raise InputError(session.recording, "is not text in UTF-8", "rename it; no table can name it")
    return tuple({(session.name, session.recording, repr(session)): session for session in found}.values())


def _sessions_of(text: str, options: TrackOptions) -> Iterator[Session]:
    path = Path(text)
    if is_address(text):
        yield Session(text, options=options)
    elif path.suffix.lower() == TABLE_ENDING:
        yield from _read_table(path, options)
    elif path.exists():
        yield from (Session(recording, options=options) for recording in _recordings_in(path))
    elif has_magic(text):
        matches = [recording for name in sorted(glob(text, recursive=True)) for recording in _recordings_in(Path(name))]
        if not matches:
            raise InputError(text, "matches no recording", "check the pattern; ** stands for any number of folders")
        yield from (Session(recording, options=options) for recording in matches)
    else:
        raise InputError(text, "is not there", "give recordings, folders of recordings, patterns or a .csv table")


def _recordings_in(path: Path) -> list[Path]:
    """Return all recordings below a folder; the path itself if it is a recording, a file, or a folder without
    recordings. The readers of recorders' files test later whether a file or a folder without recordings can be read.
    """
    if not path.is_dir() or (path / RECORDING_FILE).is_file():
        return [path]
    below = sorted(file.parent for file in path.rglob(RECORDING_FILE))
    return below or [path]


def _read_table(path: Path, options: TrackOptions) -> Iterator[Session]:
    lines = read_rows(path)
    names = lines[0][1] if lines else []
    require_distinct(path, names)
    if "recording" not in names:
        raise InputError(path, "has no column 'recording'", "begin with a line of column names, recording among them")
    for name in names:
        if name not in COLUMNS:
            near = get_close_matches(name, COLUMNS, 1)
            remedy = f"write '{near[0]}' if that is meant" if near else f"the columns may be {', '.join(COLUMNS)}"
            raise InputError(path, f"has a column '{name}', which is unknown", remedy)
    if len(lines) < 2:
        raise InputError(path, "names no recording", "add a line for each below the names of the columns")
    for number, cells in lines[1:]:
        if len(cells) > len(names):
            raise InputError(path, f"line {number} has more cells than columns", "put quotes around cells with commas")
        yield _session_of(dict(zip(names, cells, strict=False)), path, number, options)


def _session_of(row: dict[str, str], path: Path, number: int, options: TrackOptions) -> Session:
    if not row.get("recording"):
        raise InputError(path, f"line {number} names no recording", "fill in the column 'recording'")
    given: dict[str, Any] = {name: _value(name, row[name], path, number) for name in SETTINGS if row.get(name)}
    named = row["recording"]
    recording = named if is_address(named) else path.parent / named
    return Session(recording, row.get("session", ""), row.get("subject", ""), replace(options, **given))


def _value(name: str, text: str, path: Path, number: int) -> object:
    if name in FILES:
        return path.parent / text
    if name in NUMBERS:
        try:
            if abs(plain_number(text)) <= MOST_FRAMES:
                return NUMBERS[name](text)
            raise ValueError
        except ValueError:
            kind = "a whole number" if NUMBERS[name] is int else "a number"
            raise InputError(path, f"line {number} has the {name} '{text[:40]}'", f"write {kind}") from None
    if name == "smooth":
        if text.lower() not in YES_OR_NO:
            raise InputError(path, f"line {number} has '{text}' under smooth", "write yes or no")
        return YES_OR_NO[text.lower()]
    return text


BATCH_FILE: Final = "batch.json"
LOCK_FILE: Final = ".batch.lock"
LONGEST_NAME: Final = 100
"""Maximum length of a session's name in bytes. Encrypted folders allow file names of 143 bytes, and the names of some
files that a run writes are up to 30 bytes longer than the session's name, as in .NAME.json.partial-01234567.
"""

# names that Windows does not allow for files
DEVICES: Final = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
BEGINNING: Final = 2**20  # bytes at the start of a recorder's file (header, first images) that identify it
DAMAGED: Final = "choose another folder for the batch; the results in this one stay as they are"


@dataclass(frozen=True, slots=True)
class NamedRecording:
    """An entry of batch.json. session: name of the results folder; recording: absolute path or address; mark: hash that
    identifies the recording by some of its images (``_mark_of``), None if they cannot be read.
    """

    session: str
    recording: str
    subject: str = ""
    mark: str | None = None

    def is_of(self, other: NamedRecording) -> bool:
        """Return whether both entries are the same recording. This is so if their paths are equal, unless both marks
        are known and differ. It is also so if their marks are known and equal, and this entry's path does not exist,
        since the recording was then moved.
        """
        same_images = self.mark == other.mark or None in (self.mark, other.mark)
        if self.recording == other.recording:
            return same_images
        return self.mark is not None and self.mark == other.mark and not Path(self.recording).exists()


def open_folder(out: Path, sessions: Sequence[Session]) -> tuple[Session, ...]:
    """Make the folder of a batch, or check that ``out`` is such a folder; return the sessions with their names in it.

    Raises InputError if ``out`` is another kind of folder, a session's name cannot name a folder, or a given name
    belongs to another recording.
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
    _named(sessions, before, out)  # name the sessions first, so that a refusal leaves no folder behind
    with new_folder(out.resolve(), out), FileLock(out / LOCK_FILE):
        before = _read(mark)
        named = _named(sessions, before, out)
        _write(mark, (*(one for one in before if one.session not in {new.session for new in named}), *named))
    return tuple(replace(session, name=one.session) for session, one in zip(sessions, named, strict=True))


class BatchDocument(Entry):
    """The content of batch.json."""

    format: Literal["anchorpose-batch"] = "anchorpose-batch"
    version: Version = 1
    sessions: tuple[NamedRecording, ...] = ()


def _read(path: Path) -> tuple[NamedRecording, ...]:
    if not path.is_file():
        return ()
    try:
        listed = read_document(path, BatchDocument).sessions
    except InputError as error:
        raise InputError(path, f"is damaged ({error.problem})", DAMAGED) from None
    places = (one.recording if is_address(one.recording) else str(Path(one.recording).resolve()) for one in listed)
    return tuple(replace(one, recording=place) for one, place in zip(listed, places, strict=True))


def _write(path: Path, named: Sequence[NamedRecording]) -> None:
    write_text_whole(path, json.dumps(BatchDocument(sessions=tuple(named)).model_dump(), indent=1) + "\n")


def _named(sessions: Sequence[Session], before: Sequence[NamedRecording], out: Path) -> tuple[NamedRecording, ...]:
    """Return an entry of batch.json per session. A session's name is taken from the user's table, else from an earlier
    call, else it is the shortest free name.
    """
    own = [NamedRecording("", each.shown, each.subject, _mark_of(each.place)) for each in sessions]
    names = [_given(each) or _earlier(one, before) for each, one in zip(sessions, own, strict=True)]
    taken = {_key(one.session): one for one in before}
    found = dict[int, NamedRecording]()
    for index in sorted(range(len(own)), key=lambda k: names[k] is None):  # sessions with a name come first
        name = names[index] or _free(sessions[index], sessions, taken)
        own[index] = one = replace(own[index], session=name)
        _require_own(one, names[index] is None, tuple(found.values()), taken.get(_key(name)), out)
        found[index] = taken[_key(name)] = one
    return tuple(own)


def _require_own(
    one: NamedRecording, unnamed: bool, others: Sequence[NamedRecording], holder: NamedRecording | None, out: Path
) -> None:
    """Raise InputError if another session of this call (``others``) has the same name, if an unnamed session has the
    same recording as another session, or if the name belongs to another recording (``holder``).
    """
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
    """Return the name from the user's table; raises InputError if no folder can have this name."""
    name = _clean(session.name)
    if len(name.encode()) > LONGEST_NAME:
        problem = f"has a name of {len(name.encode())} bytes ({name[:20]}...)"
        raise InputError(session.shown, problem, f"give it one of {LONGEST_NAME} or less in the column 'session'")
    return name or None


def _earlier(one: NamedRecording, before: Sequence[NamedRecording]) -> str | None:
    found = [each for each in before if each.is_of(one)]
    return max(found, key=lambda each: each.recording == one.recording).session if found else None


def _free(session: Session, sessions: Sequence[Session], taken: dict[str, NamedRecording]) -> str:
    """Return a free name: the name of the recording's folder, preceded by as many parent folders as needed, or followed
    by a number.
    """
    parts = session.parts
    ends = ["-".join(parts[-count:]) for count in range(1, len(parts) + 1)]
    counts = [sum(other.parts[-k:] == parts[-k:] for other in sessions) for k in range(1, len(parts) + 1)]
    alone = [end for end, count in zip(ends, counts, strict=True) if count == 1] or ends[:1]
    names = [_short(_clean(end) or "session") for end in alone]
    numbered = (f"{names[0]}-{number}" for number in range(2, len(taken) + 3))
    return next(name for name in (*names, *numbered) if _key(name) not in taken)


def _clean(name: str) -> str:
    """Replace all characters of a name except letters, digits and . + - by underscores."""
    cleaned = re.sub(r"[^\w.+-]+", "_", unicodedata.normalize("NFC", name)).strip(".")
    return f"_{cleaned}" if DEVICES.fullmatch(cleaned) else cleaned


def _short(name: str) -> str:
    """Shorten a name that is too long; a hash of the whole name keeps it distinct."""
    if len(name.encode()) <= LONGEST_NAME:
        return name
    start = name.encode()[: LONGEST_NAME - 12].decode(errors="ignore")
    return f"{start}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def _key(name: str) -> str:
    """Return a key that is equal for names that some systems do not distinguish, since they differ only in capitals or
    in the Unicode form of accents.
    """
    return unicodedata.normalize("NFC", name.casefold())


def _mark_of(place: Path | None) -> str | None:
    """Return a hash of the first, middle and last depth image of a recording's first camera, or of the beginning and
    size of a recorder's file.
    """
    try:
        if place is None or not place.exists():
            return None
        if place.is_file():
            with open_regular(place) as stream:
                return hashlib.sha256(stream.read(BEGINNING) + str(place.stat().st_size).encode()).hexdigest()
        files = next((found for folder in sorted(place.glob("*/depth")) if (found := sorted(folder.glob("*.png")))), [])
        chosen = [files[k] for k in sorted({0, len(files) // 2, len(files) - 1})] if files else []
        return (
            hashlib.sha256(b"".join(read_whole(file, LARGEST_IMAGE, "") for file in chosen)).hexdigest()
            if chosen
            else None
        )
    except (OSError, InputError):
        return None
