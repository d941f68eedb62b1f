"""Find the sessions of a batch: recordings named one by one, by folder, by pattern, or in a table with one row each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from glob import glob, has_magic
from pathlib import Path
from typing import Any, Final

from anchorpose.cli.track_verbs import TrackOptions
from anchorpose.errors import InputError, is_utf8, without_password
from anchorpose.options import MOST_FRAMES, plain_number
from anchorpose.recording.document import read_rows, require_distinct
from anchorpose.remote import is_address, parts_of

RECORDING_FILE: Final = "recording.json"
TABLE_ENDING: Final = ".csv"
FILES: Final = ("calibration", "corrections", "motions", "config")
NUMBERS: Final = {"height": float, "start": int, "stop": int}
YES_OR_NO: Final = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False}
SETTINGS: Final = tuple(each.name for each in fields(TrackOptions) if each.name not in ("overwrite", "resume"))
COLUMNS: Final = ("recording", "session", "subject", *SETTINGS)


@dataclass(frozen=True, slots=True)
class Session:
    """One recording to track: a path, or an address as text. name: of its results folder; subject: who, as the table
    says; options: of its run."""

    recording: Path | str
    name: str = ""
    subject: str = ""
    options: TrackOptions = field(default_factory=TrackOptions)

    @property
    def place(self) -> Path | None:
        """The whole path of the recording; None where it is at an address."""
        return None if isinstance(self.recording, str) else self.recording.resolve()

    @property
    def shown(self) -> str:
        """The whole path of the recording, or its address without its password."""
        return without_password(self.recording) if isinstance(self.recording, str) else str(self.place)

    @property
    def parts(self) -> tuple[str, ...]:
        """The names of the recording and of the folders above it, the recording's last."""
        if isinstance(self.recording, str):
            return parts_of(self.recording)
        path = self.recording.resolve()
        return tuple(part for part in path.parts if part != path.anchor)

    def absolute(self) -> Session:
        """The same with paths that hold in any folder, for a worker that runs elsewhere."""
        paths = {name: getattr(self.options, name) for name in FILES}
        known: dict[str, Any] = {name: path.resolve() for name, path in paths.items() if path is not None}
        options = replace(self.options, **known)
        return replace(self, recording=self.place or self.recording, options=options)


def find_sessions(given: Sequence[str], options: TrackOptions) -> tuple[Session, ...]:
    """Return the sessions that a user names, in the order given; only a table gives them names (``names``).

    given: recordings (folders, or files of a recorder), folders that contain recordings, addresses, patterns such as
    ``clinic/*/recording``, and tables (``.csv``). options: for all of them; a row of a table overrides them. Raises
    InputError where one leads to no recording, or a table cannot be used.
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
    """The recording itself, or all recordings below a folder; a file is left to the readers of recorders' files."""
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
