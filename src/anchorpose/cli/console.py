"""Print all output of commands. Printed names may come from files, so characters that would control the terminal are
escaped.

No other module calls ``print`` or makes a console (``tests/test_structure.py``).
"""

from __future__ import annotations

import os
import sys
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from anchorpose.api.recording_input import Progress, Watcher
from anchorpose.errors import without_password

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Column
    from rich.text import Text

# Unicode categories of characters that can control a terminal: controls, line breaks, undecodable bytes
ACTING: Final = frozenset(("Cc", "Zl", "Zp", "Cs"))
BIDIRECTIONAL: Final = frozenset("\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")


def printable(text: str) -> str:
    """Return the text with each character that would control a terminal replaced by its escape, such as ``\\x1b``,
    and with passwords in addresses replaced by stars."""
    return "".join(
        each.encode("unicode_escape").decode("ascii")
        if each in BIDIRECTIONAL or unicodedata.category(each) in ACTING
        else each
        for each in without_password(text)
    )


def say(sentence: str, error: bool = False) -> None:
    """Print one line without delay; error: whether to print it on the error stream."""
    print(printable(sentence), file=sys.stderr if error else sys.stdout, flush=True)


def show_table(
    head: Iterable[str | Column],
    rows: Iterable[Iterable[str | Text]],
    *,
    title: str | None = None,
    numbers: bool = False,
) -> None:
    """Print a table of texts without markup; numbers: whether all columns except the first are aligned to the right."""
    from rich.table import Table

    table = Table(*head, title=title)
    for number, column in enumerate(table.columns if numbers else ()):
        column.no_wrap, column.justify = number == 0, "right" if number else "left"
    for row in rows:
        table.add_row(*row)
    plain_console().print(table)


def plain_console(error: bool = False) -> Console:
    """Return a console of the package rich that prints every text literally, without markup and emoji."""
    from rich.console import Console

    class PlainConsole(Console):
        def render_str(self, text: str, **options: Any) -> Text:
            return super().render_str(printable(text), **options)

    return PlainConsole(stderr=error, markup=False, emoji=False, highlight=False)


@contextmanager
def progress_bar(description: str, at_once: bool = True) -> Iterator[Progress]:
    """Draw a progress bar on the error stream, and yield the function that moves the bar. This function takes (done,
    total); total is None if it is unknown.

    at_once: if True, the bar appears at once, since the first call of the yielded function may come late. If False, the
    bar appears with the first call, so that work that is refused at its beginning shows no bar.
    """
    from rich import progress as parts

    columns = (
        parts.TextColumn("{task.description}", markup=False),
        parts.BarColumn(),
        parts.MofNCompleteColumn(),
        parts.TimeElapsedColumn(),
        parts.TextColumn("left:"),
        parts.TimeRemainingColumn(),
    )
    progress = parts.Progress(*columns, console=plain_console(error=True))
    task = progress.add_task(printable(description), total=None)

    def advance(done: int, total: int | None) -> None:
        progress.start()
        progress.update(task, completed=done, total=total)

    try:
        if at_once:
            progress.start()
        yield advance
    finally:
        if progress.live.is_started:
            progress.stop()


def open_page(page: Path) -> bool:
    """Open a page of this computer in the browser; return False if no browser can be opened.

    No browser opens in CI, on a remote machine without a display, or if the output goes to a file or another program.
    """
    import webbrowser

    return _has_display() and webbrowser.open(page.resolve().as_uri())


def _has_display() -> bool:
    if not sys.stdout.isatty() or "CI" in os.environ:
        return False
    if sys.platform in ("win32", "darwin"):
        return "SSH_CONNECTION" not in os.environ
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class OnConsole(Watcher):
    """A receiver of the progress of tracking that draws progress bars and prints notes."""

    def working(self, on: str, at_once: bool = True) -> AbstractContextManager[Progress]:
        """Return a progress bar."""
        return progress_bar(on, at_once)

    def note(self, sentence: str) -> None:
        """Print a note."""
        say(sentence)


@contextmanager
def counter(what: str) -> Iterator[Callable[[], None]]:
    """Show a line on the error stream that counts the calls of the yielded function; used for work of unknown
    length.
    """
    count = 0
    with plain_console(error=True).status("Working") as status:

        def tick() -> None:
            nonlocal count
            count += 1
            status.update(f"Working: {count} {what}")

        yield tick


def log_event(results: Path, what: str, files: Iterable[str], by: str, about: dict[str, Any] | None = None) -> None:
    """Add a line to the results' log. If the log cannot be written, as on a read-only disk, print a sentence instead.

    what: the operation, such as "measure"; files: names of the files that the operation wrote; by: initials of the
    user; about: options of the operation.
    """
    from anchorpose.results.verify import LOG_FILE, add_event

    try:
        add_event(results, what, files, by, about)
    except OSError as error:
        say(f"{results / LOG_FILE}: cannot be written ({error.strerror}): this is not logged.", error=True)


def print_outcome(results: Path) -> None:
    """Print the shares of seen, inferred and lost joints, the number of frames with problems, and the report's path."""
    import numpy as np

    from anchorpose.joints import LOST
    from anchorpose.report.page import REPORT_FILE
    from anchorpose.results.run_record import RUN_FILE, read_run
    from anchorpose.results.tables import JOINTS_FILE, read_joints

    joints = read_joints(results / JOINTS_FILE)
    seen, lost = np.mean(joints.state_code == 0), np.mean(joints.state_code == LOST)
    say(
        f"{len(joints.frame)} frames: {100 * seen:.1f} % of the joints seen, {100 * (1 - seen - lost):.1f} % inferred, "
        f"{100 * lost:.1f} % lost."
    )
    dropped = read_run(results / RUN_FILE).get("dropped", [])
    if dropped:
        count, first = len({drop["frame"] for drop in dropped}), dropped[0]
        say(f"Frames with problems: {count}; the first is frame {first['frame']}: {first['why']}.")
    say(f"Results are in {results}; open {results / REPORT_FILE} in a browser.")
