"""``anchorpose motions``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from anchorpose.cli.console import say
from anchorpose.cli.limits import FASTEST_HZ, positive
from anchorpose.errors import AnchorposeError

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
