"""The verb that tracks one recording."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from anchorpose.cli.console import say
from anchorpose.cli.limits import MOST_FRAMES, TALLEST_M, positive, whole
from anchorpose.errors import AnchorposeError

if TYPE_CHECKING:
    from anchorpose.tracker.config import TrackConfig


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class TrackOptions:
    """The options of ``anchorpose track``."""

    patient: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    """Where the patient stands at the start, as x,z in metres on the floor (x forward, z to the patient's right), or in
    frame 47 as x,z@47; needed only where there are several people and the wrong one is tracked."""

    height: Annotated[float | None, positive(TALLEST_M)] = None
    """The patient's standing height in metres, for example 1.72; it makes the lengths of the limbs more accurate. With
    or without shoes does not matter: a centimetre is allowed for. Not needed where recording.json has it."""

    calibration: Path | None = None
    """A calibration.json (or its folder) made by 'anchorpose calibrate'; its camera poses replace those of the
    recording. Without it, poses that are null in recording.json are estimated."""

    corrections: Path | None = None
    """A file of corrections made in 'anchorpose view': the person who was named is tracked, frames that were marked as
    unusable get no joints, and corrected joints are where the reviewer put them."""

    motions: Path | None = None
    """A file of reference movements made by 'anchorpose motions build', to predict from instead of those that come with
    the program."""

    config: Path | None = None
    """A TOML or JSON file with settings that differ from the defaults."""

    smooth: bool = False
    """Track backward in time as well and combine both passes: a limb that is lost in one direction is often found in
    the other. Takes about twice as long."""

    overwrite: bool = False
    """Replace an existing results folder."""

    resume: bool = False
    """Go on with a run into the same folder that was stopped or killed; it ends with the same tables. Where there is
    none, tracking begins."""

    start: Annotated[int | None, whole(0, MOST_FRAMES)] = None
    """First frame to track, counted from 0; the default is the beginning."""

    stop: Annotated[int | None, whole(0, MOST_FRAMES)] = None
    """Frame to stop before; the default is the end."""

    def settings(self) -> TrackConfig:
        """The settings of the file with the options on top; raises AnchorposeError where they do not fit."""
        from anchorpose.cli.config_file import load_track_config
        from anchorpose.settings import sentence_of

        place, frame = (None, None) if self.patient is None else parse_patient(self.patient)
        given: dict[str, Any] = {
            "start": self.start,
            "stop": self.stop,
            "smooth": self.smooth or None,
            "height_m": self.height,
            "motions": None if self.motions is None else str(self.motions),
            "patient_xz_m": place,
            "patient_frame": frame,
        }
        settings = load_track_config(self.config)
        try:
            return replace(settings, **{name: value for name, value in given.items() if value is not None})
        except ValueError as error:
            raise AnchorposeError(f"{sentence_of(error)}.") from None


def track(
    recording: str,
    /,
    *,
    results: Annotated[str, Parameter(name=["--output", "-o"])],
    options: TrackOptions | None = None,
) -> None:
    """Find the patient's 21 joints in every frame of a recording, and state which were seen and how accurate they are.

    Parameters
    ----------
    recording
        The folder with recording.json and the depth images of each camera; or a recorder's file or folder, which is
        first converted into INPUT.anchorpose beside it, as by 'anchorpose convert'. Also an address (sftp://, s3://,
        gs://), from which it is copied.
    results
        The folder to write: tables of joints, angles and contacts, run.json, report.html and the data of the viewer. It
        appears when everything is done. Also an address, to which it is copied then.
    """
    from anchorpose.remote import is_address, local_copy, local_results

    given = options or TrackOptions()
    if given.resume and is_address(results):
        raise AnchorposeError("--resume needs results in a local folder; copy them to the address when they are done.")
    with local_results(results, given.overwrite) as folder, local_copy(recording) as source:
        track_locally(source, folder, given)
        if is_address(results):
            say(f"They go to {results}.")


def track_locally(recording: Path, results: Path, given: TrackOptions, go_on: str | None = None) -> None:
    """Tracks a recording on this machine into a results folder on it, with progress, and prints what came out.

    go_on: what the user does to go on where it is stopped, None for the same command with --resume.
    """
    from anchorpose.cli.console import print_outcome, progress_bar
    from anchorpose.cli.recording_verbs import as_recording
    from anchorpose.pipeline import track_recording
    from anchorpose.results.folder import RESUME, check_results_path, unfinished_results

    settings = given.settings()
    check_results_path(results, recording, given.overwrite)
    recording = as_recording(recording)
    work = unfinished_results(results, recording, given.overwrite, given.resume, go_on or RESUME)
    with work as folder, progress_bar("Tracking") as progress:
        track_recording(recording, folder, settings, progress, given.calibration, given.corrections)
    print_outcome(results)


def parse_patient(text: str) -> tuple[tuple[float, float], int | None]:
    """``x,z`` or ``x,z@frame``: a place and the number of a frame; raises AnchorposeError otherwise."""
    place, at, frame = text.partition("@")
    if at and not frame.isdecimal():
        raise AnchorposeError(
            f"--patient is '{text}'; write the number of a frame after the @, for example 0.1,-0.2@47."
        )
    return parse_place(place), int(frame) if at else None


def parse_place(text: str, option: str = "--patient") -> tuple[float, float]:
    """``x,z`` as two finite numbers; raises AnchorposeError otherwise."""
    try:
        x, z = (float(part) for part in text.split(","))
    except ValueError:
        x = z = math.nan
    if not (math.isfinite(x) and math.isfinite(z)):
        raise AnchorposeError(f"{option} is '{text}'; write two numbers in metres with a comma, for example 0.1,-0.2.")
    return x, z
