"""``anchorpose inspect``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def inspect(
    recording: Path,
    /,
    *,
    frame: int,
    out: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    patient: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    config: Path | None = None,
    as_tracked: bool = False,
    overwrite: bool = False,
) -> None:
    """See what every stage made of one frame: pictures of each camera, and a page that shows them in order.

    Use it where a result looks wrong: the first picture that looks wrong names the stage to blame. The patient is
    followed from the nearest frame that shows him well, with a first guess of his body.

    Parameters
    ----------
    recording
        The folder with recording.json and the depth pictures of each camera.
    frame
        The number of the frame, as in the name of its picture and in the results.
    out
        The folder to write; the default is inspect-<frame> here.
    patient
        Where the patient stands in this frame, as x,z in metres on the floor; needed only where the wrong person is
        blue. With --as-tracked: where he stands at the start, as in 'anchorpose track'.
    config
        A TOML or JSON file with settings that differ from the defaults, as for 'anchorpose track'.
    as_tracked
        Learn the body and follow the patient from where tracking begins: what 'anchorpose track' makes of this
        frame without --calibration, --corrections, --height or --smooth, and as slow.
    overwrite
        Replace the folder of an earlier inspection.
    """
    from anchorpose.cli.config_file import load_track_config
    from anchorpose.cli.console import counter
    from anchorpose.cli.track import parse_place
    from anchorpose.inspecting import inspect_recording
    from anchorpose.pages.inspection_page import FACTS_FILE, PAGE_FILE
    from anchorpose.results.folder import new_results_folder

    settings = load_track_config(config)
    if patient is not None:
        settings = replace(settings, patient_xz_m=parse_place(patient))
    target = out if out is not None else Path(f"inspect-{frame}")
    with (
        new_results_folder(target, recording, overwrite, (FACTS_FILE, PAGE_FILE)) as folder,
        counter("frames read") as tick,
    ):
        inspection = inspect_recording(recording, folder, frame, settings, as_tracked, tick)
    for sentence in inspection.account:
        print(sentence)
    print(f"Open {target / PAGE_FILE} in a browser; the pictures are in {target}, one folder a camera.")
