"""``anchorpose record``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from anchorpose.cli.console import say
from anchorpose.cli.limits import DAY_S, between, positive


def record(
    *sources: str,
    recording: Annotated[Path, Parameter(name=["--output", "-o"])],
    seconds: Annotated[float | None, positive(DAY_S)] = None,
    empty_room: Annotated[float, between(0.0, DAY_S)] = 0.0,
    like: Path | None = None,
    finish: bool = False,
) -> None:
    """Record what depth cameras see: lossless, with the cameras' own times.

    Ctrl+C ends it. After a power cut all but the last second is there: '--finish' makes a recording of it.

    Parameters
    ----------
    sources
        'realsense' or 'realsense:SERIAL', 'orbbec' or 'orbbec:SERIAL', several of them; the folder of a recording is
        played at its own pace.
    recording
        The folder to write.
    seconds
        Record for so long; the default is until Ctrl+C.
    empty_room
        First look at the empty room for so many seconds: the patient is then found more easily.
    like
        An earlier recording of the same cameras in the same place: its equipment and its pictures of the empty room
        hold now, too.
    finish
        Make a recording of a folder whose recording was cut off; no sources are needed.
    """
    from anchorpose.cli.live_setup import open_sources, stop_on_signals
    from anchorpose.live.record import record_live
    from anchorpose.live.recorder import finish_recording

    if finish:
        say(f"The recording is in {finish_recording(recording)}.")
        return
    opened = open_sources(sources, like)
    with stop_on_signals() as stop:
        say(f"The recording is in {record_live(opened, recording, seconds, empty_room, say, stop)}.")
