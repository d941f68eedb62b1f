"""What ``live`` and ``record`` share: sources by name, outputs, and a Ctrl+C that ends in order."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

from anchorpose.cli.console import say
from anchorpose.errors import AnchorposeError
from anchorpose.live.output import Output
from anchorpose.live.playback import Playback
from anchorpose.live.source import LiveSource
from anchorpose.recording.reader import open_recording

if TYPE_CHECKING:
    from anchorpose.cli.live import LiveGiven
    from anchorpose.live.page_server import PageOutput


def open_sources(names: Sequence[str], like: Path | None) -> list[LiveSource]:
    """Raises AnchorposeError where a name means nothing, a camera is not there, or a recording is not alone."""
    if not names:
        raise AnchorposeError("Name a source: realsense, orbbec, or the folder of a recording.")
    about = None if like is None else open_recording(like)
    sources: list[LiveSource] = []
    for name in names:
        maker, _, serial = name.partition(":")
        if maker == "realsense":
            from anchorpose.live.realsense import open_realsense

            sources.append(open_realsense(serial, about))
        elif maker == "orbbec":
            from anchorpose.live.orbbec import open_orbbec

            sources.append(open_orbbec(serial, about))
        else:
            sources.append(Playback(open_recording(Path(name))))
    if len(sources) > 1 and any(isinstance(source, Playback) for source in sources):
        raise AnchorposeError("A recording is played alone: leave the other sources out.")
    return sources


def make_outputs(lsl: bool, osc: str | None) -> list[Output]:
    """Raises AnchorposeError where an address is none or its host unknown, MissingPackage without an extra."""
    outputs: list[Output] = []
    if lsl:
        from anchorpose.live.lsl import LslOutput

        outputs.append(LslOutput())
    if osc is not None:
        from anchorpose.live.osc import OscOutput

        host, _, port = osc.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise AnchorposeError(f"--osc is '{osc}'; write host and port, for example 127.0.0.1:9000.")
        try:
            outputs.append(OscOutput(host.removeprefix("[").removesuffix("]"), int(port)))
        except OSError as error:
            raise AnchorposeError(f"--osc is '{osc}', and there is no such host ({error.strerror}).") from None
    return outputs


@contextmanager
def page_output(given: LiveGiven) -> Iterator[list[PageOutput]]:
    """The page, opened in the browser; none where it is not asked for. Raises AnchorposeError where nothing can listen
    there."""
    if not given.page:
        yield []
        return
    from anchorpose.live.page_server import PageOutput
    from anchorpose.viewer.access import is_loopback
    from anchorpose.viewing import opened_page

    page = PageOutput(given.host, given.port)
    try:
        say(f"The page is at {page.address}")
        if not is_loopback(given.host):
            say("Anyone with this address can see the patient; it is not encrypted.")
        with nullcontext() if given.no_browser else opened_page(page.address):
            yield [page]
    finally:
        page.close()


def teller(pages: Sequence[PageOutput]) -> Callable[[str], None]:
    """What gives the user a sentence: printed, and shown on the pages."""

    def to_all(sentence: str) -> None:
        say(sentence)
        for page in pages:
            page.say(sentence)

    return to_all


def asked_on(pages: Sequence[PageOutput]) -> Callable[[], int | None]:
    """Gives the number of the person who was chosen as the patient on a page, once; None where nobody was."""
    return lambda: next((number for page in pages if (number := page.asked()) is not None), None)


@contextmanager
def stop_on_signals() -> Iterator[Event]:
    """The event that the first Ctrl+C (or the system's request to end) sets; a second one stops at once."""
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
