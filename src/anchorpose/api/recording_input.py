"""Find the recording folder for the path that a caller gives. A recording folder is used as it is; a file of another
recording program or device (recorder) is converted first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path

Progress = Callable[[int, int | None], None]


class Watcher:
    """A receiver of progress reports and notes during tracking or conversion; this base class ignores both. The command
    line has a subclass that draws progress bars and prints notes.

    how_to_resume: advice for the message of a stopped run. If it is None, the message advises the user to repeat the
    command with --resume.
    """

    def __init__(self, how_to_resume: str | None = None) -> None:
        self.how_to_resume = how_to_resume

    def working(self, on: str, at_once: bool = True) -> AbstractContextManager[Progress]:
        """Return a context manager for one piece of work, named by ``on``. It yields a function that the work calls
        with (done, total) to report progress; total is None while it is unknown.

        at_once: whether the work is shown at once; if False, the work is shown from the first progress report on.
        """
        return nullcontext(lambda done, total: None)

    def note(self, sentence: str) -> None:
        """Receive a sentence that the user should know."""


def as_recording(path: Path, watcher: Watcher) -> Path:
    """Return the recording folder for a path; a recorder's file or folder is first converted into a recording beside
    it.

    Raises InputError if the conversion is refused. A path that is not in the format of any known recorder is returned
    unchanged.
    """
    from anchorpose.sources.convert import look_at, make_recording

    recording, ready = look_at(path)
    if ready:
        return recording
    with noting_how_to_go_on(recording), watcher.working(f"Converting {path.name}", at_once=False) as progress:
        notes = make_recording(path, progress)
    for note in notes:
        watcher.note(f"- {note}")
    return recording


@contextmanager
def noting_how_to_go_on(out: Path) -> Iterator[None]:
    """Add a note on how to resume to a KeyboardInterrupt or OSError that stops a conversion into the folder ``out``."""
    from anchorpose.results.folder import naming_place

    try:
        with naming_place(out):
            yield
    except (KeyboardInterrupt, OSError) as stopped:
        stopped.add_note(f"{out} is not a recording yet: give the same command again to go on.")
        raise
