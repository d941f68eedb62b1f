"""While cameras run, receive markers of other programs by the Lab Streaming Layer, and turn these markers into trials.

``begin NAME`` begins a trial of the condition NAME and ends the previous trial; ``end`` ends the trial; ``rating
NUMBER`` rates the running or the last trial. Any other text is kept only as a marker.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, Thread
from typing import Final

from anchorpose.errors import AnchorposeError, MissingPackage
from anchorpose.options import plain_number
from anchorpose.recording.document import read_text
from anchorpose.recording.events import EVENTS_FILE, MISSING, sidecar_of
from anchorpose.recording.regular_file import is_there
from anchorpose.results.folder import write_text_whole

MARKERS_FILE: Final = "markers.tsv"
HEAD: Final = "onset\tduration\ttrial_type"

BEGIN, END, RATING = "begin", "end", "rating"
LONGEST_TEXT: Final = 200
SHORTEST_S: Final = 0.001  # s, minimum duration of a trial, so that two markers sent at once do not form a trial

FIND_S: Final = 5.0
"""Maximum time in s for which the program searches the network for a stream."""

WAIT_S: Final = 0.2


TakeMarker = Callable[[str, float], object]
"""A function that receives the text of a marker and the time, by ``time.monotonic``, at which it was sent."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A row of events.tsv, with times in seconds since the recording's first frame. rating: None without a rating."""

    condition: str
    onset_s: float
    duration_s: float
    rating: float | None = None


def plain_text(text: str) -> str:
    """Return a marker as one cell of a table: spaces replace line breaks, tabs and unprintable characters."""
    return " ".join("".join(each if each.isprintable() else " " for each in text).split())[:LONGEST_TEXT]


def trials_of(markers: Sequence[tuple[float, str]], end_s: float) -> list[Trial]:
    """Return the trials that markers (onset in s, text) define, in order of time; a trial without an end marker ends at
    ``end_s``.
    """
    found, running = list[Trial](), False
    for onset_s, text in sorted((each for each in markers if each[0] < end_s), key=lambda each: each[0]):
        word, _, rest = text.partition(" ")
        if word in (BEGIN, END) and running:
            found[-1] = replace(found[-1], duration_s=onset_s - found[-1].onset_s)
            running = False
        if word == BEGIN and rest:
            found.append(Trial(rest, max(onset_s, 0.0), 0.0))
            running = True
        elif word == RATING and found and (rating := _rating(rest)) is not None:
            found[-1] = replace(found[-1], rating=rating)
    if running:
        found[-1] = replace(found[-1], duration_s=end_s - found[-1].onset_s)
    return [trial for trial in found if trial.duration_s >= SHORTEST_S]


def _rating(text: str) -> float | None:
    try:
        return plain_number(text)
    except ValueError:
        return None


def write_events(folder: Path, end_s: float) -> None:
    """Write events.tsv from the markers in a recording folder, in the format of BIDS; if there are ratings, also
    events.json, which states their unit.

    end_s: seconds from the first frame to the last. Nothing is written if no trial began, or if events.tsv exists
    already.
    """
    if not is_there(folder / MARKERS_FILE) or is_there(folder / EVENTS_FILE):
        return
    lines = [line.split("\t") for line in read_text(folder / MARKERS_FILE).splitlines()[1:]]
    trials = trials_of([(float(cells[0]), cells[2]) for cells in lines if len(cells) == 3], end_s)
    if not trials:
        return
    rated = any(trial.rating is not None for trial in trials)
    rows = [f"{HEAD}\t{RATING}" if rated else HEAD]
    for trial in trials:
        row = f"{trial.onset_s:.4f}\t{trial.duration_s:.4f}\t{trial.condition}"
        rating = MISSING if trial.rating is None else f"{trial.rating:g}"
        rows.append(f"{row}\t{rating}" if rated else row)
    if rated:
        write_text_whole(sidecar_of(folder / EVENTS_FILE), json.dumps({RATING: {"Units": "score"}}, indent=1) + "\n")
    write_text_whole(folder / EVENTS_FILE, "\n".join(rows) + "\n")


class MarkerInlet:
    """A reader of a marker stream (Lab Streaming Layer) that reads in its own thread from ``start`` to ``stop``."""

    def __init__(self, name: str) -> None:
        """Find the stream called ``name``. Raises MissingPackage if pylsl is missing, AnchorposeError if no such stream
        of texts is found within ``FIND_S`` seconds, or if ``name`` contains a quote (').
        """
        try:
            import pylsl
        except (ImportError, RuntimeError):  # RuntimeError: the library of pylsl does not load on this system
            raise MissingPackage("--markers", "pylsl", "sync") from None
        if "'" in name:
            raise AnchorposeError(f"--markers is {name[:40]!r}; give the name of a stream without quotes.")
        found = pylsl.resolve_bypred(f"name='{name}'", timeout=FIND_S)
        if not found:
            raise AnchorposeError(
                f"No stream of markers is named '{name[:40]}'; start the program that sends it first."
            )
        if found[0].channel_format() != pylsl.cf_string:
            raise AnchorposeError(f"The stream '{name[:40]}' holds numbers; give the name of a stream of markers.")
        self._clock, self._inlet = pylsl.local_clock, pylsl.StreamInlet(found[0])
        self._stop = Event()
        self._thread: Thread | None = None

    def start(self, take: TakeMarker) -> None:
        """Pass each marker from now on to the function ``take``."""
        self._inlet.open_stream(timeout=FIND_S)
        self._thread = Thread(target=self._run, args=(take,), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop receiving markers; may be called twice."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        self._inlet.close_stream()

    def _run(self, take: TakeMarker) -> None:
        while not self._stop.is_set():
            sample, stamp = self._inlet.pull_sample(timeout=WAIT_S)
            if sample is not None:
                # ``time_correction``, the offset between the two computers' clocks, waits for the sender's reply at the
                # first call
                sent_s = stamp + self._inlet.time_correction(timeout=FIND_S)
                take(str(sample[0]), time.monotonic() - (self._clock() - sent_s))
