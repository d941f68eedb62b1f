"""Verbs about a recording before it is tracked: convert, check, calibrate."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from anchorpose.cli.console import say, show
from anchorpose.cli.limits import FASTEST_HZ, positive
from anchorpose.errors import AnchorposeError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from anchorpose.calibration.calibration import Calibration
    from anchorpose.check.material import Finding
    from anchorpose.sources.plan import ConvertOptions


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ConvertFlags:
    """The options of ``anchorpose convert``: what the files do not say."""

    intrinsics: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    """The lens as fx,fy,cx,cy in pixels of the depth image, for files that have none."""

    depth_scale: Annotated[float | None, positive(1.0)] = None
    """Metres per grey value, for example 0.001 where depth is in millimetres; where given, it replaces the file's."""

    fps: Annotated[float | None, positive(FASTEST_HZ)] = None
    """Depth images per second, for files that have no times."""

    rotate: Literal["0", "90", "180", "270"] = "0"
    """Turn the images clockwise by so many degrees, where the camera was mounted on its side or upside down."""

    mirror: bool = False
    """Exchange left and right, where the recorder mirrored its images: depth alone cannot show that it did."""

    def options(self) -> ConvertOptions:
        """Raises AnchorposeError for numbers that are none."""
        from anchorpose.sources.plan import ConvertOptions, parse_intrinsics

        for name, value in (("depth-scale", self.depth_scale), ("fps", self.fps)):
            if value is not None and not 0 < value <= 1000:
                raise AnchorposeError(f"--{name} is {value:g}; give a number above 0.")
        return ConvertOptions(
            intrinsics=None if self.intrinsics is None else parse_intrinsics(self.intrinsics),
            depth_scale=self.depth_scale,
            fps=self.fps,
            rotate={"0": 0, "90": 90, "180": 180, "270": 270}[self.rotate],  # type: ignore[arg-type]
            mirror=self.mirror,
        )


def convert(*paths: Path, options: ConvertFlags | None = None) -> None:
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
    settings = (options or ConvertFlags()).options()
    with _noting_how_to_go_on(out), progress_bar("Converting", at_once=False) as progress:
        done = convert_files(inputs, out, settings, progress)
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
    from rich.table import Table
    from rich.text import Text

    table = Table("", "check", "measured", "what to do")
    for finding in sorted(findings, key=lambda one: -one.level):
        word = Text(finding.level.word, style=COLOURS[finding.level])
        table.add_row(word, finding.check, finding.measured, finding.remedy)
    show(table)
    counts = [sum(finding.level == level for finding in findings) for level in range(len(COLOURS))]
    say(", ".join(f"{count} {word}" for count, word in zip(counts, COLOURS, strict=True)) + ".")


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
    from anchorpose.pipeline import calibrate_recording
    from anchorpose.results.folder import CALIBRATION, check_results_path, new_results_folder

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

    from anchorpose.calibration.calibration import calibration_rows

    table = Table("camera", "pose", "± mm", "± degrees", "surface rms mm", "outline rms px")
    for row in calibration_rows(found):
        table.add_row(*row)
    show(table)
    for note in found.notes:
        say(f"- {note}")
