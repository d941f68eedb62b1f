"""What verbs print: progress, and a summary of a results folder."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def progress_bar(description: str, at_once: bool = True) -> Iterator[Callable[[int, int | None], None]]:
    """A bar on the error stream; what it yields is called with (done, total), None where the total is unknown.

    at_once: shown before the first call, which may take long, or not: then work that is refused shows no bar.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(),
    )
    progress = Progress(*columns, console=Console(stderr=True))
    task = progress.add_task(description, total=None)

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


@contextmanager
def counter(what: str) -> Iterator[Callable[[], None]]:
    """A line on the error stream that counts calls, for work whose length is unknown."""
    from rich.console import Console

    count = 0
    with Console(stderr=True).status("Working") as status:

        def tick() -> None:
            nonlocal count
            count += 1
            status.update(f"Working: {count} {what}")

        yield tick


def log_event(results: Path, what: str, files: Iterable[str], by: str, about: dict[str, Any] | None = None) -> None:
    """Adds a line to the results' log; where that fails, as on a disk that is read-only, a sentence says so."""
    from anchorpose.results.event_log import LOG_FILE, add_event

    try:
        add_event(results, what, files, by, about)
    except OSError as error:
        print(f"{results / LOG_FILE}: cannot be written ({error.strerror}): this is not logged.", file=sys.stderr)


def print_outcome(results: Path) -> None:
    """Prints how much was seen, inferred and lost, what was dropped, and where the report is."""
    import numpy as np

    from anchorpose.joints import LOST
    from anchorpose.report.page import REPORT_FILE
    from anchorpose.results.run_document import read_run
    from anchorpose.results.run_record import RUN_FILE
    from anchorpose.results.tables import JOINTS_FILE, read_joints

    joints = read_joints(results / JOINTS_FILE)
    seen, lost = np.mean(joints.state_code == 0), np.mean(joints.state_code == LOST)
    print(
        f"{len(joints.frame)} frames: {100 * seen:.1f} % of the joints seen, {100 * (1 - seen - lost):.1f} % inferred, "
        f"{100 * lost:.1f} % lost."
    )
    dropped = read_run(results / RUN_FILE).get("dropped", [])
    if dropped:
        count, first = len({drop["frame"] for drop in dropped}), dropped[0]
        print(f"Frames with problems: {count}; the first is frame {first['frame']}: {first['why']}.")
    print(f"Results are in {results}; open {results / REPORT_FILE} in a browser.")
