"""``anchorpose inspect``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from anchorpose.cli.console import say
from anchorpose.cli.limits import MOST_FRAMES, whole


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class InspectOptions:
    """The options of ``anchorpose inspect``."""

    patient: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    """Where the patient stands in this frame, as x,z in metres on the floor; needed only where the wrong person is
    blue. With --as-tracked: where the patient stands at the start, as in 'anchorpose track'."""

    config: Path | None = None
    """A TOML or JSON file with settings that differ from the defaults, as for 'anchorpose track'."""

    as_tracked: bool = False
    """Learn the body and follow the patient from where tracking begins: the result of 'anchorpose track' for this frame
    without --calibration, --corrections, --height or --smooth, and as slow."""

    overwrite: bool = False
    """Replace the folder of an earlier inspection."""


def inspect(
    recording: Path,
    /,
    *,
    frame: Annotated[int, whole(0, MOST_FRAMES)],
    out: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    options: InspectOptions | None = None,
) -> None:
    """See the result of every stage in one frame: pictures for each camera, and a page that shows them in order.

    Use it where a result looks wrong: the first picture that looks wrong shows which stage failed. The patient is
    followed from the nearest frame in which they are clearly visible, with a first estimate of their body.

    Parameters
    ----------
    recording
        The folder with recording.json and the depth images of each camera, or a recorder's file or folder, as for
        'anchorpose track'.
    frame
        The number of the frame, as in the name of its depth image and in the results.
    out
        The folder to write; the default is inspect-<frame> here.
    """
    from anchorpose.cli.config_file import load_track_config
    from anchorpose.cli.console import counter
    from anchorpose.cli.convert import as_recording
    from anchorpose.cli.track import parse_patient
    from anchorpose.inspecting import inspect_recording
    from anchorpose.pages.inspection_page import INSPECTION, PAGE_FILE
    from anchorpose.results.folder import check_results_path, new_results_folder

    given = options or InspectOptions()
    settings = load_track_config(given.config)
    if given.patient is not None:
        place, at = parse_patient(given.patient)
        settings = replace(settings, patient_xz_m=place, patient_frame=at)
    target = out or Path(f"inspect-{frame}")
    check_results_path(target, recording, given.overwrite, INSPECTION)
    recording = as_recording(recording)
    with new_results_folder(target, recording, given.overwrite, INSPECTION) as folder, counter("frames read") as tick:
        inspection = inspect_recording(recording, folder, frame, settings, given.as_tracked, tick)
    for sentence in inspection.account:
        say(sentence)
    say(f"Open {target / PAGE_FILE} in a browser; the pictures are in {target}, one folder per camera.")
