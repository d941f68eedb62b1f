"""The corrections of one sitting: read from the file, extended by what the page sends, written whole each time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from anchorpose.recording.document import JsonObject
from anchorpose.results.corrections import (
    Corrections,
    now_utc,
    parse_entry,
    parse_withdrawal,
    read_corrections,
    require_recording,
    write_corrections,
)
from anchorpose.results.run_record import plain
from anchorpose.results.tables import JointTable
from anchorpose.viewer.file_lock import locked


class Correcting:
    """Adds to and takes back from one file; the file is locked and read again for each change, so nobody's work is
    lost, whichever viewer it is done in.

    begun: what holds while there is no file; the first change writes it there too, so that a second round of review
    keeps what the first one found. Raises InputError where the file cannot be used, or is about another recording or
    world.
    """

    def __init__(self, path: Path, begun: Corrections, joints: JointTable) -> None:
        self.path, self.begun = path, begun
        self._time_s = dict(zip(joints.frame.tolist(), joints.time_s.tolist(), strict=True))
        self.current()

    def current(self) -> Corrections:
        """What the file holds now; what it begins with where there is none yet."""
        if not self.path.exists():
            return self.begun
        found = read_corrections(self.path)
        require_recording(self.path, found, self.begun.recording)
        return found

    def add(self, given: dict[str, Any]) -> Corrections:
        """One more correction, without its times and its ``when``, which are put in here; raises InputError."""
        timed = {**given, "when": now_utc()}
        for frame, time in (("first_frame", "start_s"), ("last_frame", "end_s"), ("frame", "time_s")):
            if frame in given:
                timed[time] = self._time_of(given[frame])
        entry = parse_entry(JsonObject(Path("correction"), "", timed))
        with locked(self.path):
            after = self.current().added(entry)
            write_corrections(self.path, after)
        return after

    def take_back(self, given: dict[str, Any]) -> Corrections:
        """Moves an ``entry``, given as it stands in the file, to what was withdrawn, by ``who``; raises InputError, or
        ValueError where the entry does not hold."""
        entry, by = parse_withdrawal(JsonObject(Path("correction"), "", {**given, "when": now_utc()}))
        with locked(self.path):
            after = self.current().taken_back(entry, by)
            write_corrections(self.path, after)
        return after

    def _time_of(self, frame: Any) -> float:
        if frame not in self._time_s:
            raise ValueError(f"the results have no frame {frame}")
        return self._time_s[frame]


def shown(corrections: Corrections) -> dict[str, Any]:
    """What holds, as the page reads it."""
    return {"unusable": plain(corrections.unusable), "joints": plain(corrections.joints)}
