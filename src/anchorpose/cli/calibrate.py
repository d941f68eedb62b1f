"""``anchorpose calibrate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from anchorpose.cli.console import say, show

if TYPE_CHECKING:
    from anchorpose.calibration.calibration import Calibration


def calibrate(
    recording: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    overwrite: bool = False,
    ignore_given: bool = False,
    markers: Path | None = None,
    config: Path | None = None,
) -> None:
    """Find where every camera stands, from the equipment in its depth images and equipment.json alone.

    Nothing needs to be clicked or put up. Writes calibration.json, which 'track --calibration' reads, and one picture
    per camera with the equipment drawn where it was found: look at them. A pose that is uncertain is refused.

    Parameters
    ----------
    recording
        The folder with recording.json and the depth images of each camera, or a recorder's file or folder, as for
        'anchorpose track'; nothing is written into it.
    output
        The folder to write; by default beside the recording, named like it with '-calibration' at the end.
    overwrite
        Replace an existing calibration folder.
    ignore_given
        Also find the poses that recording.json gives.
    markers
        A markers.json that states where each printed AprilTag or the ChArUco board is: cameras whose folder holds an
        image of them, infrared.png or color.png, are placed by these instead of by depth.
    config
        A TOML or JSON file with settings that differ from the defaults, as for track.
    """
    from anchorpose.cli.config_file import load_track_config
    from anchorpose.cli.convert import as_recording
    from anchorpose.pipeline import calibrate_recording
    from anchorpose.results.calibration_file import CALIBRATION
    from anchorpose.results.folder import check_results_path, new_results_folder

    settings = load_track_config(config)
    source = recording.resolve()
    target = output if output is not None else source.with_name(f"{source.name}-calibration")
    check_results_path(target, recording, overwrite, CALIBRATION)
    recording = as_recording(recording)
    with new_results_folder(target, recording, overwrite, CALIBRATION) as folder:
        found = calibrate_recording(recording, folder, settings, ignore_given, markers)
    _print_poses(found)
    say(f"The calibration is in {target}; look at its pictures before you use it.")


def _print_poses(found: Calibration) -> None:
    from rich.table import Table

    from anchorpose.results.calibration_file import calibration_rows

    table = Table("camera", "pose", "± mm", "± degrees", "surface rms mm", "outline rms px")
    for row in calibration_rows(found):
        table.add_row(*row)
    show(table)
    for note in found.notes:
        say(f"- {note}")
