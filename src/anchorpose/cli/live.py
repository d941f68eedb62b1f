"""``anchorpose live``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from anchorpose.cli.console import say
from anchorpose.cli.limits import DAY_S, LARGEST_PORT, TALLEST_M, positive, whole


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class LiveGiven:
    """The options of ``anchorpose live``."""

    wait_frames: Literal[0, 1] = 0
    """Later frames to wait for before a frame is answered. 1 was more accurate only in a clinic with one camera."""

    start_seconds: Annotated[float, positive(DAY_S)] = 6.0
    """How long room and patient are looked at before the body is learnt; the patient should move a little meanwhile."""

    seconds: Annotated[float | None, positive(DAY_S)] = None
    """Track for so long; the default is until Ctrl+C, or until the source ends."""

    patient: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    """Where the patient stands at the start, as x,z in metres on the floor; needed only where there are several people
    and the wrong one is tracked."""

    height: Annotated[float | None, positive(TALLEST_M)] = None
    """The patient's standing height in metres, for example 1.72."""

    calibration: Path | None = None
    """A calibration.json made by 'anchorpose calibrate' of the same cameras; without it, poses are found in the first
    seconds."""

    like: Path | None = None
    """An earlier recording of the same cameras in the same place: its equipment and its pictures of the empty room hold
    now, too. Of a recording that is played, its own hold."""

    record: Path | None = None
    """A folder to keep all depth images in, as a recording."""

    config: Path | None = None
    """A TOML or JSON file with settings that differ from the defaults."""

    lsl: bool = False
    """Send joints and angles as Lab Streaming Layer streams."""

    osc: str | None = None
    """Send joints and angles as OSC messages to this HOST:PORT."""

    page: bool = False
    """Show skeleton and angles in the browser, for patient and therapist."""

    host: str = "127.0.0.1"
    """The network address that the page listens on. Any other than the default lets other computers see the patient:
    they need the whole printed address, which holds a secret."""

    port: Annotated[int, whole(0, LARGEST_PORT)] = 8470
    """The port of the page, always the same, so that the browser remembers the chosen angles; 0 takes a free one."""

    no_browser: bool = False
    """Print the address of the page only."""

    finish: bool = False
    """Make the results folder of a session that was cut off, of all that was tracked; no sources are needed."""

    overwrite: bool = False
    """Replace an existing results folder."""


def live(
    *sources: str,
    results: Annotated[Path, Parameter(name=["--output", "-o"])],
    options: LiveGiven | None = None,
) -> int:
    """Find the patient's joints while the patient stands there, and send them to other programs.

    Ctrl+C ends it with a finished results folder, as 'anchorpose track' makes one. Where the program is killed or the
    disk is full, '--finish' makes one of what was tracked.

    Parameters
    ----------
    sources
        Where depth images come from: 'realsense' or 'realsense:SERIAL', 'orbbec' or 'orbbec:SERIAL', several of them;
        or the folder of a recording, which is played at its own pace.
    results
        The folder to write.
    """
    from anchorpose.cli.console import print_outcome
    from anchorpose.cli.live_setup import asked_on, make_outputs, open_sources, page_output, stop_on_signals, teller
    from anchorpose.cli.track import TrackOptions
    from anchorpose.live.finish import finish_session
    from anchorpose.live.first_seconds import LiveOptions, User
    from anchorpose.live.session import track_live
    from anchorpose.live.source import about_folder
    from anchorpose.results.unfinished import unfinished_results

    given = options or LiveGiven()
    if given.finish:
        finish_session(results, given.overwrite)
        print_outcome(results)
        return 0
    config = TrackOptions(patient=given.patient, height=given.height, config=given.config).settings()
    chosen = LiveOptions(
        config=config,
        wait_frames=given.wait_frames,
        start_s=given.start_seconds,
        calibration=given.calibration,
        record=given.record,
        seconds=given.seconds,
    )
    opened = open_sources(sources, given.like)
    with (
        stop_on_signals() as stop,
        unfinished_results(results, about_folder(opened), given.overwrite) as folder,
        page_output(given) as page,
    ):
        outputs = [*make_outputs(given.lsl, given.osc), *page]
        summary = track_live(opened, folder, chosen, outputs, User(teller(page), stop, asked_on(page)))
    say(f"{summary.sentence}. The results are in {results}.")
    return 0
