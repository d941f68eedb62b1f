"""``anchorpose convert``, and the same for verbs that are given a recorder's file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from anchorpose.cli.console import say
from anchorpose.cli.limits import FASTEST_HZ, positive
from anchorpose.errors import AnchorposeError

if TYPE_CHECKING:
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
