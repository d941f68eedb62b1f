"""``anchorpose track``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from anchorpose.errors import AnchorposeError


def track(
    recording: Path,
    /,
    *,
    results: Annotated[Path, Parameter(name=["--output", "-o"])],
    patient: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    height: float | None = None,
    calibration: Path | None = None,
    corrections: Path | None = None,
    motions: Path | None = None,
    config: Path | None = None,
    smooth: bool = False,
    overwrite: bool = False,
    start: int | None = None,
    stop: int | None = None,
) -> None:
    """Find the patient's 21 joints in every frame of a recording, with what was seen and how sure it is.

    Parameters
    ----------
    recording
        The folder with recording.json and the depth pictures of each camera.
    results
        The folder to write: tables of joints, angles and contacts, run.json, report.html and what the viewer needs. It
        appears when all is done.
    patient
        Where the patient stands at the start, as x,z in metres on the floor (x forward, z to the patient's right);
        needed only where several people are in the picture and the choice comes out wrong.
    height
        The patient's standing height in metres, for example 1.72: his bones are then found more exactly. With or
        without shoes does not matter, a centimetre is allowed for. Not needed where recording.json has it.
    calibration
        A calibration.json (or its folder) made by 'anchorpose calibrate'; its poses replace those of the recording.
        Without it poses that are null in recording.json are found.
    corrections
        A file of corrections made in 'anchorpose view': frames that a reviewer marked as unusable get no joints, and
        joints that he moved are where he says.
    motions
        A file of reference movements made by 'anchorpose motions build', to predict by instead of those that come with
        the program.
    config
        A TOML or JSON file with settings that differ from the defaults.
    smooth
        Follow the patient against time as well and put both together: limbs that are lost in one direction are often
        found in the other. Takes about twice as long, and cannot be done while recording.
    overwrite
        Replace an existing results folder.
    start
        First frame to track, counted from 0; the default is the beginning.
    stop
        Frame to stop before; the default is the end.
    """
    from anchorpose.cli.config_file import load_track_config
    from anchorpose.cli.console import print_outcome, progress_bar
    from anchorpose.pipeline import track_recording
    from anchorpose.results.folder import new_results_folder

    settings = load_track_config(config)
    given: dict[str, Any] = {
        "start": start,
        "stop": stop,
        "smooth": smooth or None,
        "height_m": height,
        "motions": None if motions is None else str(motions),
        "patient_xz_m": None if patient is None else parse_place(patient),
    }
    try:
        settings = replace(settings, **{name: value for name, value in given.items() if value is not None})
    except ValueError as error:
        raise AnchorposeError(f"{error}.") from None
    with new_results_folder(results, recording, overwrite) as folder, progress_bar("Tracking") as progress:
        track_recording(recording, folder, settings, progress, calibration, corrections)
    print_outcome(results)


def parse_place(text: str, option: str = "--patient") -> tuple[float, float]:
    """``x,z`` as two finite numbers; raises AnchorposeError otherwise."""
    import math

    try:
        x, z = (float(part) for part in text.split(","))
    except ValueError:
        x = z = math.nan
    if not (math.isfinite(x) and math.isfinite(z)):
        raise AnchorposeError(f"{option} is '{text}'; write two numbers in metres with a comma, for example 0.1,-0.2.")
    return x, z
