"""Define the commands that use connected cameras: live and record."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from anchorpose.cli.console import print_outcome, say
from anchorpose.cli.settings_file import SettingsFile
from anchorpose.cli.track_verbs import RunOptions
from anchorpose.cli.viewing_verbs import PageOptions
from anchorpose.errors import AnchorposeError
from anchorpose.options import DAY_S, LARGEST_PORT, OUTPUT, between, positive, whole

if TYPE_CHECKING:
    from anchorpose.live.feed import LiveSource
    from anchorpose.live.output import Output
    from anchorpose.live.page_server import PageOutput


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class LiveGiven:
    """The options of ``anchorpose live``."""

    wait_frames: Literal[0, 1] = 0
    """Number of later frames that are awaited before the joints of a frame are computed. In tests, 1 was more accurate
    than 0 only in a clinic with one camera."""

    start_seconds: Annotated[float, positive(DAY_S)] = 6.0
    """How many seconds of room and patient are recorded to learn the body; the patient should move a little."""

    seconds: Annotated[float | None, positive(DAY_S)] = None
    """Track for this many seconds; by default until Ctrl+C, or until the source ends."""

    like: Path | None = None
    """An earlier recording of the same cameras in the same place, whose equipment and images of the empty room are used
    again. Not needed for a recording that is played: it has its own."""

    record: Path | None = None
    """A folder in which all depth images are kept, as a recording."""

    markers: str | None = None
    """With --record: the name of a Lab Streaming Layer stream whose markers are kept with the recording. The markers
    'begin NAME', 'end' and 'rating NUMBER' become trials in its events.tsv."""

    lsl: bool = False
    """Send joints and angles as Lab Streaming Layer streams."""

    osc: str | None = None
    """Send joints and angles as OSC messages to this HOST:PORT."""

    page: bool = False
    """Show skeleton and angles in the browser, for patient and therapist."""

    port: Annotated[int, whole(0, LARGEST_PORT)] = 8470
    """The port of the page, always the same, so that the browser remembers the chosen angles; 0: any free port."""

    finish: bool = False
    """Make the results folder of a session that was cut off, from all tracked frames; no sources are needed."""


def live(
    *sources: str,
    results: Annotated[Path, OUTPUT],
    run: RunOptions | None = None,
    browser: PageOptions | None = None,
    options: LiveGiven | None = None,
) -> int:
    """Find the patient's joints while the cameras record, and send them to other programs.

    Ctrl+C ends the session with a complete results folder, like that of 'anchorpose track'. If the program is killed or
    the disk is full, '--finish' makes such a folder from the tracked frames.

    Parameters
    ----------
    sources
        Where depth images come from: one or more cameras, each 'realsense', 'realsense:SERIAL', 'orbbec' or
        'orbbec:SERIAL'; or the folder of a recording, which is played at recorded speed.
    results
        The folder to write.
    """
    from anchorpose.live.feed import about_folder
    from anchorpose.live.first_seconds import LiveOptions, User
    from anchorpose.live.session import track_live
    from anchorpose.live.stored import finish_session
    from anchorpose.recording.writable import check_place
    from anchorpose.results.unfinished import unfinished_results

    run, browser, given = run or RunOptions(), browser or PageOptions(), options or LiveGiven()
    if given.finish:
        finish_session(results, run.overwrite)
        print_outcome(results)
        return 0
    chosen = LiveOptions(
        config=run.settings(),
        wait_frames=given.wait_frames,
        start_s=given.start_seconds,
        calibration=run.calibration,
        record=given.record,
        seconds=given.seconds,
        markers=given.markers,
    )
    if given.markers is not None and given.record is None:
        raise AnchorposeError("--markers keeps markers with a recording; add --record FOLDER.")
    opened = open_sources(sources, given.like)
    if given.record is not None:
        check_place(given.record, about_folder(opened), results)
    with (
        stop_on_signals() as stop,
        unfinished_results(results, about_folder(opened), run.overwrite) as folder,
        page_output(given, browser) as page,
    ):
        user = User(say, stop) if page is None else User(_also_on(page), stop, page.asked, page.keep_markers)
        outputs = [*make_outputs(given.lsl, given.osc), *([] if page is None else [page])]
        summary = track_live(opened, folder, chosen, outputs, user)
    say(f"{summary.sentence}. The results are in {results}.")
    return 0


def record(
    *sources: str,
    recording: Annotated[Path, OUTPUT],
    seconds: Annotated[float | None, positive(DAY_S)] = None,
    empty_room: Annotated[float, between(0.0, DAY_S)] = 0.0,
    like: Path | None = None,
    markers: str | None = None,
    finish: bool = False,
    defaults: SettingsFile | None = None,
) -> None:
    """Record the depth images of connected cameras: lossless, with the cameras' own times.

    Ctrl+C ends the recording. After a power cut, all but the last second is kept: '--finish' makes a recording of it.

    Parameters
    ----------
    sources
        One or more cameras, each 'realsense', 'realsense:SERIAL', 'orbbec' or 'orbbec:SERIAL'; or the folder of a
        recording, which is played at recorded speed.
    recording
        The folder to write.
    seconds
        How many seconds to record; by default until Ctrl+C.
    empty_room
        How many seconds to record the empty room first: the patient is then found more easily.
    like
        An earlier recording of the same cameras in the same place, whose equipment and images of the empty room are
        used again.
    markers
        The name of a Lab Streaming Layer stream whose markers are kept. The markers 'begin NAME', 'end' and 'rating
        NUMBER' become the trials of events.tsv.
    finish
        Complete the recording in a folder where recording was cut off; no sources are needed.
    """
    from anchorpose.live.record import record_live
    from anchorpose.live.recorder import finish_recording
    from anchorpose.recording.document import read_document
    from anchorpose.recording.recording_file import RECORDING_FILE, RecordingDocument

    if finish:
        finish_recording(recording)
    else:
        opened = open_sources(sources, like)
        with stop_on_signals() as stop:
            record_live(opened, recording, seconds, empty_room, say, stop, markers)
    for note in read_document(recording / RECORDING_FILE, RecordingDocument).notes:
        say(f"{note}.")
    say(f"The recording is in {recording}.")


def open_sources(names: Sequence[str], like: Path | None) -> list[LiveSource]:
    """Open the sources by name; raises AnchorposeError for a missing camera, or a recording among several sources.

    like: an earlier recording of the same cameras in the same place, or None.
    """
    from anchorpose.live.cameras import Playback, open_orbbec, open_realsense
    from anchorpose.recording.reader import open_recording

    if not names:
        raise AnchorposeError("Name a source: realsense, orbbec, or the folder of a recording.")
    about = None if like is None else open_recording(like)
    sources: list[LiveSource] = []
    for name in names:
        maker, _, serial = name.partition(":")
        if maker == "realsense":
            sources.append(open_realsense(serial, about))
        elif maker == "orbbec":
            sources.append(open_orbbec(serial, about))
        else:
            sources.append(Playback(open_recording(Path(name))))
    if len(sources) > 1 and any(isinstance(source, Playback) for source in sources):
        raise AnchorposeError("A recording is played alone: leave the other sources out.")
    return sources


def make_outputs(lsl: bool, osc: str | None) -> list[Output]:
    """Open the chosen outputs: LSL streams (``lsl``) and OSC messages (``osc``, HOST:PORT). Raises AnchorposeError for
    a malformed address or an unknown host, and MissingPackage if the package of an output is not installed.
    """
    from anchorpose.live.output import LslOutput, OscOutput

    outputs: list[Output] = []
    if lsl:
        outputs.append(LslOutput())
    if osc is not None:
        host, _, port = osc.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise AnchorposeError(f"--osc is '{osc}'; write host and port, for example 127.0.0.1:9000.")
        try:
            outputs.append(OscOutput(host.removeprefix("[").removesuffix("]"), int(port)))
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or "no host has such a name"
            raise AnchorposeError(f"--osc is '{osc[:60]}', and there is no such host ({why}).") from None
    return outputs


def _also_on(page: PageOutput) -> Callable[[str], None]:
    """Return a function that prints a sentence in the terminal, and also shows it on the page."""

    def tell(sentence: str) -> None:
        say(sentence)
        page.say(sentence)

    return tell


@contextmanager
def page_output(given: LiveGiven, browser: PageOptions) -> Iterator[PageOutput | None]:
    """Open the page in the browser, or yield None if no page is wanted; raises AnchorposeError if its host and port
    cannot be used."""
    if not given.page:
        yield None
        return
    from anchorpose.live.page_server import PageOutput

    page = PageOutput(browser.host, given.port, has_markers=given.record is not None)
    try:
        with browser.showing(page.address, "The page", "see the patient"):
            yield page
    finally:
        page.close()


@contextmanager
def stop_on_signals() -> Iterator[Event]:
    """Yield an event that is set by the first Ctrl+C, or by the system's first request to end the process (SIGTERM). A
    second Ctrl+C or request ends the process.
    """
    stop = Event()
    before: dict[int, Any] = {}

    def ask(number: int, frame: object) -> None:
        if stop.is_set():
            signal.signal(number, before[number])
            signal.raise_signal(number)
        stop.set()

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            before[number] = signal.signal(number, ask)
    try:
        yield stop
    finally:
        for changed, handler in before.items():
            signal.signal(changed, handler)
