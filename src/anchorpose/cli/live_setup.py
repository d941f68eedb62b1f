"""What ``live`` and ``record`` share: sources by name, outputs, and a Ctrl+C that ends in order."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import Any

from anchorpose.errors import AnchorposeError
from anchorpose.live.output import Output
from anchorpose.live.playback import Playback
from anchorpose.live.source import LiveSource
from anchorpose.recording.reader import open_recording


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
    """Raises AnchorposeError where an address is none, MissingPackage where an extra is not installed."""
    outputs: list[Output] = []
    if lsl:
        from anchorpose.live.lsl import LslOutput

        outputs.append(LslOutput())
    if osc is not None:
        from anchorpose.live.osc import OscOutput

        host, _, port = osc.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise AnchorposeError(f"--osc is '{osc}'; write host and port, for example 127.0.0.1:9000.")
        outputs.append(OscOutput(host, int(port)))
    return outputs


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
