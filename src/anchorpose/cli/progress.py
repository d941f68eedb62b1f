"""How far along, and how much longer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(description: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on the error stream; call what it yields with (done, total) as often as you like."""
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
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task(description, total=None)

        def advance(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total)

        yield advance


@contextmanager
def counter(what: str) -> Iterator[Callable[[], None]]:
    """A line on the error stream that counts calls, for work whose end is not known beforehand."""
    from rich.console import Console

    count = 0
    with Console(stderr=True).status("Working") as status:

        def tick() -> None:
            nonlocal count
            count += 1
            status.update(f"Working: {count} {what}")

        yield tick
