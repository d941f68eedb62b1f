"""``anchorpose view``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from anchorpose.cli.console import say
from anchorpose.cli.limits import LARGEST_PORT, whole


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """The options of ``anchorpose view``."""

    corrections: Path | None = None
    """The file that your corrections are added to; the default is RESULTS.corrections.json, beside the folder. A new
    file begins with the corrections that the results were tracked with."""

    who: str = ""
    """Your initials or pseudonym, for the corrections; otherwise the page asks you once."""

    host: str = "127.0.0.1"
    """The network address to listen on. Any other address than the default lets other computers see the patient: they
    need the whole printed address, which holds a secret."""

    port: Annotated[int, whole(0, LARGEST_PORT)] = 0
    """The port to listen on; the default is a free one."""

    no_browser: bool = False
    """Print the address only."""


def view(results: Path, recording: Path | None = None, /, *, options: ViewOptions | None = None) -> None:
    """Look at results in the browser, and mark what is wrong with them.

    Plays the patient's skeleton and body at recorded speed, with the points of the depth cameras around them and the
    angle curves beside. Press ? in the page for all keys. What you mark (who the patient is, parts of the
    recording that are unusable, joints that are in the wrong place) is saved at once; 'anchorpose track --corrections
    FILE' uses it. Nothing leaves this computer. Stop with Ctrl+C.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    recording
        The recording, or the recorder's file, that the results were made from; without it only skeleton, body and
        curves are shown.
    """
    from contextlib import nullcontext

    from anchorpose.cli.convert import as_recording
    from anchorpose.viewer.access import is_loopback
    from anchorpose.viewing import open_viewer, opened_page

    given = options or ViewOptions()
    recording = None if recording is None else as_recording(recording)
    with open_viewer(results, recording, given.corrections, given.who, given.host, given.port) as server:
        try:
            say(f"The viewer is at {server.address}")
            if not is_loopback(given.host):
                say("Anyone with this address can see the patient and change the corrections; it is not encrypted.")
            say(f"Corrections go to {server.api.corrections.path}. Stop with Ctrl+C.")
            with nullcontext() if given.no_browser else opened_page(server.address):
                server.serve_forever()
        except KeyboardInterrupt:
            say("Stopped; every correction was saved when it was made.")
