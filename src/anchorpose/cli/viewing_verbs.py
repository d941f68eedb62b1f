"""Define the commands that show pages or pictures: view for results, inspect for every stage of one frame."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from anchorpose.cli.console import OnConsole, counter, say
from anchorpose.cli.settings_file import SettingsFile, tracking_settings
from anchorpose.errors import AnchorposeError
from anchorpose.options import LARGEST_PORT, MOST_FRAMES, OUTPUT, SIGNED, whole

if TYPE_CHECKING:
    from anchorpose.viewer.server import ReviewServer


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class PageOptions:
    """The options of the commands that show a page, ``anchorpose view`` and ``live``."""

    host: str = "127.0.0.1"
    """The network address to listen on. Any other address than the default lets other computers see the patient, if
    they have the whole printed address, which contains a secret."""

    no_browser: bool = False
    """Only print the address; do not open the browser."""

    @contextmanager
    def showing(self, address: str, what: str, others_may: str) -> Iterator[None]:
        """Print the address and open it in the browser for the duration of the with block.

        what: the page's name in the message. others_may: words that say what other people who have the address can do.
        """
        from anchorpose.viewer.access import is_loopback
        from anchorpose.viewer.guarded_server import opened_page

        say(f"{what} is at {address}")
        if not is_loopback(self.host):
            say(f"Anyone with this address can {others_may}; it is not encrypted.")
        with nullcontext() if self.no_browser else opened_page(address):
            yield


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ViewOptions(PageOptions):
    """The options of ``anchorpose view``."""

    corrections: Path | None = None
    """The file to which your corrections are added; by default RESULTS.corrections.json, beside the folder. A new file
    begins with the corrections with which the results were tracked."""

    port: Annotated[int, whole(0, LARGEST_PORT)] = 0
    """The port to listen on; by default any free port."""

    who: str = ""
    """Your initials or pseudonym, for the corrections; without this option, the page asks you once."""

    rate: bool = False
    """Rate the trials blinded instead: they are shown in random order, without condition, number, setting or measure.
    Scores (0 to 10) go to RESULTS.rating_AB.tsv, beside the folder; after a stop, the same command continues."""

    rater: str = ""
    """With --rate: your initials, 1 to 8 letters; each rater has a separate file."""

    def require_rater(self, results: Path) -> None:
        """Raise AnchorposeError or InputError if --rate is given without initials, or initials without --rate."""
        from anchorpose.viewer.rating import require_initials

        if self.rate:
            require_initials(results, self.rater)
        elif self.rater:
            raise AnchorposeError("--rater belongs to the page for raters; add --rate.")


def view(
    results: Path,
    recording: Path | None = None,
    /,
    *,
    options: ViewOptions | None = None,
    defaults: SettingsFile | None = None,
) -> None:
    """Look at results in the browser, and correct them.

    The page plays the patient's skeleton and body at recorded speed, with the points of the depth cameras and the angle
    curves. Press ? in the page for all keys. You can name the patient, mark unusable parts of the recording and move
    joints. Corrections are saved at once; 'anchorpose track --corrections FILE' uses them. Nothing leaves this
    computer. Stop with Ctrl+C. With --rate, the command shows a page for blinded raters instead.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    recording
        The recording, or the recorder's file, from which the results were made; without it only skeleton, body and
        curves are shown.
    """
    from anchorpose.api.recording_input import as_recording
    from anchorpose.viewer.rating import open_rating
    from anchorpose.viewer.server import open_viewer

    given = options or ViewOptions()
    given.require_rater(results)
    recording = None if recording is None else as_recording(recording, OnConsole())
    if given.rate:
        with open_rating(results, recording, given.rater, given.host, given.port) as server:
            _serve(
                server,
                given.showing(server.address, "The page for raters", "see the patient and change the scores"),
                f"Scores go to {server.api.scores.path}. Stop with Ctrl+C.",
                "Stopped; every score was saved when it was given; the same command goes on.",
            )
        return
    with open_viewer(results, recording, given.corrections, given.who, given.host, given.port) as server:
        _serve(
            server,
            given.showing(server.address, "The viewer", "see the patient and change the corrections"),
            f"Corrections go to {server.api.corrections.path}. Stop with Ctrl+C.",
            "Stopped; every correction was saved when it was made.",
        )


def _serve(server: ReviewServer, showing: AbstractContextManager[None], began: str, stopped: str) -> None:
    """Serve a page until Ctrl+C. began and stopped: sentences that are printed at the beginning and at the end."""
    try:
        with showing:
            say(began)
            server.serve_forever()
    except KeyboardInterrupt:
        say(stopped)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class InspectOptions:
    """The options of ``anchorpose inspect``."""

    patient: Annotated[str | None, SIGNED] = None
    """Where the patient stands in this frame, as x,z in metres on the floor; needed only if the pictures show the wrong
    person in blue. With --as-tracked: where the patient stands at the start, as in 'anchorpose track'."""

    config: Path | None = None
    """A TOML or JSON settings file: settings of tracking, and defaults for these options in its table [inspect]."""

    as_tracked: bool = False
    """Learn the body and follow the patient from the frame in which tracking begins. The result is that of 'anchorpose
    track' without --calibration, --corrections, --height and --smooth, and it takes as long."""

    overwrite: bool = False
    """Replace the folder of an earlier inspection."""


def inspect(
    recording: Path,
    /,
    *,
    frame: Annotated[int, whole(0, MOST_FRAMES)],
    out: Annotated[Path | None, OUTPUT] = None,
    options: InspectOptions | None = None,
) -> None:
    """Show the result of every stage in one frame: pictures for each camera, and a page that shows them in order.

    Use this command if a result looks wrong: the first picture that looks wrong shows which stage failed. The patient
    is followed from the nearest frame in which they are clearly visible, with a first estimate of their body.

    Parameters
    ----------
    recording
        The folder with recording.json and the depth images of each camera, or a recorder's file or folder, as for
        'anchorpose track'.
    frame
        The number of the frame, as in the name of its depth image and in the results.
    out
        The folder to write; by default inspect-<frame> in the current folder.
    """
    from anchorpose.api.recording_input import as_recording
    from anchorpose.cli.track_verbs import parse_patient
    from anchorpose.pages.inspection_page import INSPECTION, PAGE_FILE, inspect_recording
    from anchorpose.results.folder import check_results_path, new_results_folder

    given = options or InspectOptions()
    settings = tracking_settings(given.config)
    if given.patient is not None:
        place, at = parse_patient(given.patient)
        settings = replace(settings, patient_xz_m=place, patient_frame=at)
    target = out or Path(f"inspect-{frame}")
    check_results_path(target, recording, given.overwrite, INSPECTION)
    recording = as_recording(recording, OnConsole())
    with new_results_folder(target, recording, given.overwrite, INSPECTION) as folder, counter("frames read") as tick:
        inspection = inspect_recording(recording, folder, frame, settings, given.as_tracked, tick)
    for sentence in inspection.account:
        say(sentence)
    say(f"Open {target / PAGE_FILE} in a browser; the pictures are in {target}, one folder per camera.")
