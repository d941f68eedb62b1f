"""The verb that tracks many recordings."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from anchorpose.cli.console import say
from anchorpose.cli.limits import MOST_FRAMES, MOST_PROCESSES, whole
from anchorpose.errors import InputError

if TYPE_CHECKING:
    from anchorpose.batch.summary import SessionRow

EXIT_FAILED = 1


def batch(
    *recordings: str,
    out: Annotated[Path, Parameter(name=["--output", "-o"])],
    workers: Annotated[int | None, whole(1, MOST_PROCESSES)] = None,
    scheduler: str | None = None,
    slurm: Path | None = None,
    index: Annotated[int | None, whole(0, MOST_FRAMES)] = None,
    summary: bool = False,
    config: Path | None = None,
    smooth: bool = False,
) -> int:
    """Track many recordings, several at a time, and write a table and a page over all of them.

    Stop it at any time: the same command goes on from there, and does only what is not done. A recording that fails
    keeps no other from being tracked; the exit code is then 1.

    Parameters
    ----------
    recordings
        Recordings, folders that contain recordings, addresses (sftp://, s3://, gs://), patterns in quotes
        ('clinic/*/recording'), or a .csv table with one row per session: a column 'recording', and if you like
        'session', 'subject', 'height' and other options of 'anchorpose track', such as 'patient' or 'smooth'.
    out
        The folder to write: a results folder for each session in 'sessions', tables, and index.html.
    workers
        How many sessions are tracked at once; by default one per core. Each takes up to 1 GB of memory.
    scheduler
        The address of a dask scheduler that runs, for example tcp://10.0.0.5:8786, or slurm. By default, this machine.
    slurm
        A TOML file for '--scheduler slurm' with what a job needs: queue, account, memory, walltime and other options of
        dask_jobqueue.SLURMCluster.
    index
        Track only the session with this number, counted from 0, for a job array of any scheduler; afterwards use
        --summary.
    summary
        Track nothing; write the tables and the page from what is there.
    config
        A TOML or JSON file with settings for all recordings, as for 'anchorpose track'.
    smooth
        Track all recordings backward in time as well, as 'anchorpose track --smooth'.
    """
    from anchorpose.batch.cluster import CONNECT_S, SLURM, Place
    from anchorpose.batch.sessions import find_sessions
    from anchorpose.batch.tracking import run_batch, run_one, summarise
    from anchorpose.cli.config_file import read_toml
    from anchorpose.cli.console import progress_bar
    from anchorpose.cli.track_verbs import TrackOptions
    from anchorpose.recording.writable import check_place

    check_place(out)
    if not recordings:
        raise InputError(out, "is to hold no session", "give recordings, folders, patterns or a .csv table")
    place = Place(workers, scheduler, {} if slurm is None else read_toml(slurm))
    options = TrackOptions(config=config, smooth=smooth)
    options.settings()  # a mistake in the file is one sentence now, not one per session
    sessions = find_sessions(recordings, options)
    if summary:
        return _print_rows(summarise(sessions, out), out)
    if index is not None:
        row = run_one(sessions, out, index)
        say(f"{row.session}: {row.state}. {row.why or ''}".strip())
        return EXIT_FAILED if row.why else 0
    try:
        if place.scheduler is not None and place.scheduler != SLURM:
            say(f"Asking the scheduler at {place.scheduler}, for {CONNECT_S:g} s at most.")
        with progress_bar("Sessions") as progress:
            rows = run_batch(sessions, out, place, progress)
    except KeyboardInterrupt as stopped:
        stopped.add_note("What was done is kept: the same command goes on from here.")
        raise
    return _print_rows(rows, out)


def _print_rows(rows: tuple[SessionRow, ...], out: Path) -> int:
    for row in rows:
        if row.why:
            say(f"{row.session}: {row.why}")
    counts = Counter(row.state for row in rows)
    states = ", ".join(f"{count} {state}" for state, count in counts.items())
    say(f"{states}. Open {out / 'index.html'} in a browser.")
    return EXIT_FAILED if counts["failed"] else 0
