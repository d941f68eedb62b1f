"""Verbs that make what tracking compares with: the equipment and the reference movements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from anchorpose.cli.console import say, show_table
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.options import FASTEST_HZ, OUTPUT, SIGNED, positive

if TYPE_CHECKING:
    from anchorpose.calibration.proposal import FittedRoom
    from anchorpose.calibration.proposal_readings import Region


equipment = App(name="equipment", help="The model of the equipment, equipment.json.")


@equipment.command
def fit(
    recording: Path,
    /,
    *,
    out: Annotated[Path, OUTPUT] = Path("equipment.json"),
    camera: str | None = None,
    around: Annotated[str, SIGNED] = "0,0",
    radius: Annotated[float, positive(20.0)] = 1.0,
    overwrite: bool = False,
) -> None:
    """Propose equipment.json: the posts, rails and bars in the depth images of the empty room, as boxes and tubes.

    Look at the pictures that it writes and correct the file by hand: a side that no camera sees is a guess, and the
    table says which. Then name the file as "equipment" in recording.json.

    Parameters
    ----------
    recording
        The folder of a recording with a background.png for each camera.
    out
        The file to write; a picture of each camera with the parts drawn in goes beside it.
    camera
        Use this camera only; needed where the poses of several cameras are unknown.
    around
        Where the equipment stands, as x,z in metres on the floor; the default is the world's origin.
    radius
        How far around that place to look for it, in metres.
    overwrite
        Replace an existing file.
    """
    from anchorpose.calibration.proposal import fit_equipment
    from anchorpose.pages.canvas import as_png
    from anchorpose.pages.stage_drawing import draw_model
    from anchorpose.recording.equipment import read_equipment, write_equipment
    from anchorpose.recording.reader import open_recording
    from anchorpose.recording.writable import check_file, new_folder, whole_file
    from anchorpose.results.folder import naming_place

    check_file(out, '"equipment-model"', of_recording=True)
    if out.exists() and not overwrite:
        raise InputError(out, "exists already", "choose another name, or give --overwrite to replace it")
    fitted = fit_equipment(open_recording(recording), camera, _region(around, radius))
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


def _region(around: str, radius: float) -> Region:
    from anchorpose.calibration.proposal_readings import Region
    from anchorpose.cli.track_verbs import parse_place

    try:
        return Region(center_xz_m=parse_place(around, "--around"), radius_m=radius)
    except ValueError:
        raise AnchorposeError(f"--radius is {radius:g}; give a length in metres, above 0.") from None


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

    Give it to 'anchorpose track' as --motions. It replaces the movements that come with the program; name it among the
    sources of the next file to add to it. Movements like those of the patient help most: their own earlier sessions.

    Parameters
    ----------
    out
        The file to write, ending in .npz.
    sources
        Results folders of 'anchorpose track' (frames with a lost joint are left out), and skeleton files: .npz with
        joints_mm (frames, joints, 3) with Y up, offsets (where each clip begins, and the end), names (of the clips)
        and joint_names. Joints are matched by name.
    rate_hz
        Frames per second of those skeleton files that do not state it themselves (as rate_hz).
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
