"""Define the commands that prepare tracking: convert, check and calibrate prepare a recording; equipment and motions
make the files of equipment and of reference movements that tracking uses.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from anchorpose.cli.console import OnConsole, progress_bar, say, show_table
from anchorpose.cli.settings_file import SettingsFile, tracking_settings
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.options import FASTEST_HZ, OUTPUT, SIGNED, ConvertOptions, between, positive

if TYPE_CHECKING:
    from collections.abc import Sequence

    from anchorpose.calibration.proposal import FittedRoom
    from anchorpose.check.material import Finding


def convert(*paths: Path, options: ConvertOptions | None = None, defaults: SettingsFile | None = None) -> None:
    """Make a recording from the files of a camera's own recorder; docs/guide/convert.md lists the formats.

    Depth, times, lens and serial number are kept exactly; colour is neither read nor copied. 'track', 'calibrate',
    'inspect' and 'view' also take such a file directly. After a stop with Ctrl+C, the same command continues.

    Parameters
    ----------
    paths
        INPUT... OUT: one or more files or folders, which become the cameras of one recording, and the folder to write.
    """
    from anchorpose.api.recording_input import noting_how_to_go_on
    from anchorpose.sources.convert import convert as convert_files

    if len(paths) < 2:
        raise AnchorposeError("Give one or more files or folders of a recorder, and last the folder to write.")
    *inputs, out = paths
    with noting_how_to_go_on(out), progress_bar("Converting", at_once=False) as progress:
        done = convert_files(inputs, out, options or ConvertOptions(), progress)
    for note in done.notes:
        say(f"- {note}")
    counts = ", ".join(f"{name} with {count} depth images" for name, count in done.cameras)
    say(f"The recording is in {out}: {counts}.")


COLOURS = ("green", "yellow", "red")


def check(recording: Path, /) -> int:
    """Check whether a recording is good enough to track: each line is green, yellow or red and states a remedy.

    Green means that all is well. Yellow: results will be less accurate, or have gaps. Red: results will be wrong or
    missing. Check before the patient has left: the command examines some frames, which takes less than a minute. The
    exit code is 0 if nothing is red, else 1.

    Parameters
    ----------
    recording
        The folder with recording.json and the depth images of each camera; nothing is written into it. Or a file of a
        camera's recorder (see docs/guide/convert.md).
    """
    from anchorpose.api.recording_input import as_recording
    from anchorpose.check.material import Level
    from anchorpose.check.recording_check import check_recording

    findings = check_recording(as_recording(recording, OnConsole()))
    _print_findings(findings)
    return int(any(finding.level is Level.RED for finding in findings))


def _print_findings(findings: Sequence[Finding]) -> None:
    from rich.text import Text

    worst_first = sorted(findings, key=lambda one: -one.level)
    words = [Text(finding.level.name.lower(), style=COLOURS[finding.level]) for finding in worst_first]
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
    """Find the pose of every camera from the equipment in its depth images and equipment.json.

    Without equipment.json, the floor and people who walk are used. The command writes calibration.json, which
    'track --calibration' reads, and one picture per camera with the equipment drawn where it was found: look at these
    pictures. An uncertain pose is refused.

    Parameters
    ----------
    recording
        The folder with recording.json and the depth images of each camera, or a recorder's file or folder, as for
        'anchorpose track'; nothing is written into it.
    output
        The folder to write; by default the recording's path with '-calibration' added.
    overwrite
        Replace an existing calibration folder.
    ignore_given
        Also find the poses that recording.json gives.
    markers
        A markers.json that states where each printed AprilTag or the ChArUco board is. The pose of a camera is found
        from these markers, not from depth, if its folder has an image of them (infrared.png or color.png).
    config
        A TOML or JSON settings file: settings of tracking, and in its table [calibrate] defaults for these options.
    """
    from anchorpose.api.recording_input import as_recording
    from anchorpose.calibration.calibration import calibration_rows
    from anchorpose.pipeline import calibrate_recording
    from anchorpose.results.folder import CALIBRATION, check_results_path, new_results_folder

    settings = tracking_settings(config)
    source = recording.resolve()
    target = output if output is not None else source.with_name(f"{source.name}-calibration")
    check_results_path(target, recording, overwrite, CALIBRATION)
    recording = as_recording(recording, OnConsole())
    with new_results_folder(target, recording, overwrite, CALIBRATION) as folder:
        found = calibrate_recording(recording, folder, settings, ignore_given, markers)
    show_table(("camera", "pose", "± mm", "± degrees", "surface rms mm", "outline rms px"), calibration_rows(found))
    for note in found.notes:
        say(f"- {note}")
    say(f"The calibration is in {target}; look at its pictures before you use it.")


equipment = App(name="equipment", help="The model of the equipment, equipment.json.")


@equipment.command
def fit(
    recording: Path,
    /,
    *,
    out: Annotated[Path, OUTPUT] = Path("equipment.json"),
    camera: str | None = None,
    around: Annotated[str, SIGNED] = "0,0",
    radius: Annotated[float, between(0.01, 20.0)] = 1.0,
    overwrite: bool = False,
) -> None:
    """Propose equipment.json: the posts, rails and bars in the depth images of the empty room, as boxes and tubes.

    Look at the pictures that the command writes, and correct the file by hand: sides that no camera sees are guesses,
    which the printed table names. Then name the file as "equipment" in recording.json.

    Parameters
    ----------
    recording
        The folder of a recording with a background.png for each camera.
    out
        The file to write. Beside it, a picture per camera is written with the parts drawn in.
    camera
        Use this camera only; needed if the poses of several cameras are unknown.
    around
        Where the equipment stands, as x,z in metres on the floor; the default is the world's origin.
    radius
        How far around that place to search for equipment, in metres.
    overwrite
        Replace an existing file.
    """
    from anchorpose.calibration.proposal import fit_equipment
    from anchorpose.calibration.proposal_readings import Region
    from anchorpose.cli.track_verbs import parse_place
    from anchorpose.pages.canvas import as_png
    from anchorpose.pages.stage_drawing import draw_model
    from anchorpose.recording.equipment import read_equipment, write_equipment
    from anchorpose.recording.reader import open_recording
    from anchorpose.recording.writable import check_file, new_folder, whole_file
    from anchorpose.results.folder import naming_place

    check_file(out, '"equipment-model"', of_recording=True)
    if out.exists() and not overwrite:
        raise InputError(out, "exists already", "choose another name, or give --overwrite to replace it")
    place = Region(center_xz_m=parse_place(around, "--around"), radius_m=radius)
    fitted = fit_equipment(open_recording(recording), camera, place)
    pictures = [out.with_name(f"{out.stem}_{view.name}.png") for view in fitted.cameras]
    for picture in pictures:
        if picture.exists() and not overwrite:
            raise InputError(picture, "exists already", "choose another name, or give --overwrite to replace it")
    with new_folder(out.resolve().parent, out), naming_place(out):
        write_equipment(out, fitted.proposal.model)
        model = read_equipment(out)
        for picture, view, room in zip(pictures, fitted.cameras, fitted.rooms_m, strict=True):
            with whole_file(picture) as partial:
                partial.write_bytes(as_png(draw_model(view, room, model)))
    _print_parts(fitted)
    say(f"{out} is a proposal: compare it with {out.stem}_<camera>.png beside it before you use it.")


def _print_parts(fitted: FittedRoom) -> None:
    from anchorpose.recording.equipment import Box

    rows = list[tuple[str, ...]]()
    for proposed in fitted.proposal.parts:
        part = proposed.part
        box = isinstance(part, Box)
        lengths = part.size_m if isinstance(part, Box) else (2.0 * part.radius_m, part.length_m)
        size = " x ".join(f"{1000 * length:.0f}" for length in lengths)
        shape, size = ("box", size) if box else ("tube", f"ø {size}")
        off, guessed = f"{1000 * proposed.residual_m:.1f}", ", ".join(proposed.guessed)
        rows.append((part.name, shape, size, off, str(proposed.readings), guessed))
    show_table(("part", "shape", "size mm", "off by mm", "pixels", "a guess"), rows)
    for note in fitted.notes:
        say(f"{note[0].upper()}{note[1:]}.")
    share = 100 * fitted.proposal.explained_share
    say(f"{share:.1f} % of what stands free there lies within 15 mm of a part.")
    if any(proposed.guessed for proposed in fitted.proposal.parts):
        say(
            "Guessed: no camera sees the other side, so the bar is taken to be square, or to end where it is last seen."
        )


motions = App(name="motions", help="Reference movements, from which tracking predicts the next frames.")


@motions.command
def build(
    out: Path,
    /,
    *sources: Path,
    rate_hz: Annotated[float | None, Parameter(name="--rate"), positive(FASTEST_HZ)] = None,
    overwrite: bool = False,
) -> None:
    """Make a file of reference movements from earlier results and from skeletons of other trackers.

    Use it with 'anchorpose track --motions FILE'; it then replaces the movements that come with the program. To extend
    such a file, name it among the sources of a new file. The patient's own earlier sessions help most.

    Parameters
    ----------
    out
        The file to write, ending in .npz.
    sources
        Results folders of 'anchorpose track' (frames with a lost joint are left out), and skeleton files: .npz with
        joints_mm (frames, joints, 3) with Y up, offsets (first frame of each clip, and the end), names (of the clips)
        and joint_names. Joints are matched by name.
    rate_hz
        Frames per second of skeleton files that do not state it themselves (as rate_hz).
    overwrite
        Replace an existing file.
    """
    from anchorpose.results.folder import naming_place
    from anchorpose.results.reference_clips import build_motions

    if not sources:
        raise AnchorposeError("No sources are given; name results folders or skeleton files after the file's name.")
    with naming_place(out):
        clips = build_motions(out, sources, rate_hz, overwrite)
    for note in clips.notes:
        say(f"{note}.")
    say(f"{out}: {len(clips.names)} clips, {clips.frame_count} frames. Use it with: anchorpose track --motions {out}")
