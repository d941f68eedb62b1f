"""Verbs about a recording before it is tracked: convert, check, calibrate."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from anchorpose.cli.console import say, show_table
from anchorpose.errors import AnchorposeError
from anchorpose.options import OUTPUT, ConvertOptions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from anchorpose.calibration.calibration import Calibration
    from anchorpose.check.material import Finding


def convert(*paths: Path, options: ConvertOptions | None = None) -> None:
    """Make a recording of the files that a camera's own recorder wrote; what the formats are: docs/guide/convert.md.

    Depth, times, lens and serial number are kept exactly; colour is neither read nor copied. 'track', 'calibrate',
    'inspect' and 'view' also take such a file directly. Stopped with Ctrl+C, the same command goes on where it was.

    Parameters
    ----------
    paths
        INPUT... OUT: one or more files or folders, which become the cameras of one recording, and the folder to write.
    """
    from anchorpose.cli.console import progress_bar
    from anchorpose.sources.convert import convert as convert_files

    if len(paths) < 2:
        raise AnchorposeError("Give one or more files or folders of a recorder, and last the folder to write.")
    *inputs, out = paths
    with _noting_how_to_go_on(out), progress_bar("Converting", at_once=False) as progress:
        done = convert_files(inputs, out, options or ConvertOptions(), progress)
    for note in done.notes:
        say(f"- {note}")
    counts = ", ".join(f"{name} with {count} depth images" for name, count in done.cameras)
    say(f"The recording is in {out}: {counts}.")


def as_recording(path: Path) -> Path:
    """The recording that a verb was given; a recorder's file is converted first, beside it."""
    from anchorpose.cli.console import progress_bar
    from anchorpose.sources.convert import look_at, make_recording

    direct = look_at(path)
    if direct.ready:
        return direct.recording
    with _noting_how_to_go_on(direct.recording), progress_bar(f"Converting {path.name}", at_once=False) as progress:
        notes = make_recording(direct, progress)
    for note in notes:
        say(f"- {note}")
    return direct.recording


@contextmanager
def _noting_how_to_go_on(out: Path) -> Iterator[None]:
    from anchorpose.results.folder import naming_place

    try:
        with naming_place(out):
            yield
    except KeyboardInterrupt as stopped:
        stopped.add_note(f"{out} is not a recording yet: give the same command again to go on.")
        raise


COLOURS = ("green", "yellow", "red")


def check(recording: Path, /) -> int:
    """See whether a recording is good enough to track: green, yellow or red, each with what to do.

    Green is as it should be. Yellow: results will be less accurate, or have gaps. Red: results will be wrong or
    missing. Do it before the patient has left: some frames are looked at, which takes less than a minute. The exit
    code is 0 where nothing is red, 1 where something is.

    Parameters
    ----------
    recording
        The folder with recording.json and the depth images of each camera, into which nothing is written; or a file of
        a camera's recorder (see docs/guide/convert.md).
    """
    from anchorpose.check.material import Level
    from anchorpose.check.recording_check import check_recording

    findings = check_recording(as_recording(recording))
    _print_findings(findings)
    return int(any(finding.level is Level.RED for finding in findings))


def _print_findings(findings: Sequence[Finding]) -> None:
    from rich.text import Text

    worst_first = sorted(findings, key=lambda one: -one.level)
    words = [Text(finding.level.word, style=COLOURS[finding.level]) for finding in worst_first]
    cells = ((word, one.check, one.measured, one.remedy) for word, one in zip(words, worst_first, strict=True))
    show_table(("", "check", "measured", "what to do"), cells)
    counts = [sum(finding.level == level for finding in findings) for level in range(len(COLOURS))]
    say(", ".join(f"{count} {word}" for count, word in zip(counts, COLOURS, strict=True)) + ".")


def calibrate(
    recording: Path,
    /,
    *,
    output: Annotated[Path | None, OUTPUT] = None,
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
    from anchorpose.pipeline import calibrate_recording
    from anchorpose.results.folder import CALIBRATION, check_results_path, new_results_folder
    from anchorpose.tracker.config import load_track_config

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
    from anchorpose.calibration.calibration import calibration_rows

    show_table(("camera", "pose", "± mm", "± degrees", "surface rms mm", "outline rms px"), calibration_rows(found))
    for note in found.notes:
        say(f"- {note}")
