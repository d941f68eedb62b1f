"""Define the commands that track: track for one recording, batch for many."""

from __future__ import annotations

import math
from collections import Counter
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from anchorpose.cli.console import OnConsole, print_outcome, progress_bar, say
from anchorpose.cli.settings_file import tracking_settings
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.options import (
    FARTHEST_M,
    MOST_FRAMES,
    MOST_PROCESSES,
    OUTPUT,
    SIGNED,
    TALLEST_M,
    plain_number,
    positive,
    whole,
)

if TYPE_CHECKING:
    from anchorpose.tracker.config import TrackConfig


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """The options of ``anchorpose track`` and ``anchorpose live``."""

    patient: Annotated[str | None, SIGNED] = None
    """Where the patient stands: x,z in metres on the floor (x forward, z to the patient's right) at the start, or
    x,z@47 in frame 47. Needed only if there are several people and the wrong one is tracked."""

    height: Annotated[float | None, positive(TALLEST_M)] = None
    """The patient's standing height in metres, for example 1.72; it makes the lengths of the limbs more accurate. An
    error of a centimetre, as from shoes, does not matter. Not needed if recording.json has the height."""

    calibration: Path | None = None
    """A calibration.json made by 'anchorpose calibrate', or its folder; its camera poses replace those of the
    recording. Without it, poses that are null in recording.json are estimated."""

    config: Path | None = None
    """A TOML or JSON settings file: settings of tracking, and defaults for these options in a table with the name of
    the command, such as [track]."""

    overwrite: bool = False
    """Replace an existing results folder."""

    def settings(self, **more: Any) -> TrackConfig:
        """Return the settings of the settings file; the given options and ``more`` replace some of these settings.
        Raises AnchorposeError if the resulting settings contradict each other.
        """
        from anchorpose.settings import sentence_of

        place, frame = (None, None) if self.patient is None else parse_patient(self.patient)
        given = {"height_m": self.height, "patient_xz_m": place, "patient_frame": frame, **more}
        settings = tracking_settings(self.config)
        try:
            return replace(settings, **{name: value for name, value in given.items() if value is not None})
        except ValueError as error:
            raise AnchorposeError(f"{sentence_of(error)}.") from None


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class TrackOptions(RunOptions):
    """The options of ``anchorpose track``."""

    corrections: Path | None = None
    """A file of corrections made in 'anchorpose view': the person who was named there is tracked, frames that were
    marked as unusable get no joints, and corrected joints are where the reviewer put them."""

    events: Path | None = None
    """A table of the trials (events.tsv: onset, duration, trial_type and your own columns). It replaces the table in
    the recording folder. Every measure is then also computed per trial and per condition."""

    motions: Path | None = None
    """A file of reference movements made by 'anchorpose motions build'. The next pose is predicted from these instead
    of from the movements that come with the program."""

    smooth: bool | None = None
    """Track backward in time as well and combine both passes: a limb that is lost in one direction is often found in
    the other. Takes about twice as long."""

    threads: Annotated[int, whole(1, MOST_PROCESSES)] = 1
    """Number of threads that share the cameras and people of a frame; it does not change the results."""

    resume: bool = False
    """Continue a run into the same folder that was stopped or killed; it ends with the same tables as without the stop.
    If there is no such run, tracking begins."""

    start: Annotated[int | None, whole(0, MOST_FRAMES)] = None
    """First frame to track, counted from 0; the default is the beginning."""

    stop: Annotated[int | None, whole(0, MOST_FRAMES)] = None
    """Frame to stop before; the default is the end."""

    def settings(self, **more: Any) -> TrackConfig:
        """Return the settings as ``RunOptions.settings`` does, with the options of ``anchorpose track``."""
        motions = None if self.motions is None else str(self.motions)
        return super().settings(start=self.start, stop=self.stop, smooth=self.smooth, motions=motions, **more)


def track(recording: str, /, *, results: Annotated[str, OUTPUT], options: TrackOptions | None = None) -> None:
    """Find the patient's 21 joints in every frame of a recording, and state which were seen and how accurate they are.

    Parameters
    ----------
    recording
        The folder with recording.json and the depth images of each camera; or a recorder's file or folder, which is
        first converted into INPUT.anchorpose beside it, as by 'anchorpose convert'. It may also be an address (sftp://,
        s3://, gs://), from which the recording is copied.
    results
        The folder to write: tables of joints, angles and contacts, run.json, report.html and the data of the viewer. It
        appears when tracking is complete. It may also be an address, to which the folder is then copied.
    """
    from anchorpose.remote import is_address, local_copy, local_results

    given = options or TrackOptions()
    if given.resume and is_address(results):
        raise AnchorposeError("--resume needs results in a local folder; copy them to the address when they are done.")
    with local_results(results) as folder, local_copy(recording) as source:
        track_locally(source, folder, given)
        if is_address(results):
            say(f"The results are copied to {results}.")


def track_locally(recording: Path, results: Path, given: TrackOptions, go_on: str | None = None) -> None:
    """Track a recording on this machine into a local results folder, show progress, and print a summary.

    go_on: advice in words on how the user continues after a stop; None advises to repeat the command with --resume.
    """
    from anchorpose.api.track import Options, track_watched

    options = Options(
        given.settings(),
        given.calibration,
        given.corrections,
        given.events,
        given.overwrite,
        given.resume,
        given.threads,
    )
    track_watched(recording, results, options, OnConsole(go_on))
    print_outcome(results)


def parse_patient(text: str) -> tuple[tuple[float, float], int | None]:
    """Parse ``x,z`` or ``x,z@frame`` into metres and a frame number or None; raises AnchorposeError otherwise."""
    place, at, frame = text.partition("@")
    if at and not frame.isdecimal():
        raise AnchorposeError(
            f"--patient is '{text}'; write the number of a frame after the @, for example 0.1,-0.2@47."
        )
    return parse_place(place), int(frame) if at else None


def parse_place(text: str, option: str = "--patient") -> tuple[float, float]:
    """Parse ``x,z`` as two numbers in metres; raises AnchorposeError, which names ``option``, for any other text."""
    try:
        x, z = (plain_number(part) for part in text.split(","))
    except ValueError:
        x = z = math.nan
    if not (abs(x) <= FARTHEST_M and abs(z) <= FARTHEST_M):
        raise AnchorposeError(
            f"{option} is '{text[:60]}'; write two numbers in metres with a comma, up to {FARTHEST_M:g}, "
            "for example 0.1,-0.2."
        )
    return x, z


EXIT_FAILED = 1


def batch(
    *recordings: str,
    out: Annotated[Path, OUTPUT],
    workers: Annotated[int | None, whole(1, MOST_PROCESSES)] = None,
    scheduler: str | None = None,
    slurm: Path | None = None,
    index: Annotated[int | None, whole(0, MOST_FRAMES)] = None,
    summary: bool = False,
    config: Path | None = None,
    smooth: bool | None = None,
) -> int:
    """Track many recordings, several at a time, and write a table and a page about all of them.

    You may stop it at any time: the same command continues and tracks only the sessions that are not done. A recording
    that fails does not stop the others; the exit code is then 1.

    Parameters
    ----------
    recordings
        Recordings, folders that contain recordings, addresses (sftp://, s3://, gs://), patterns in quotes
        ('clinic/*/recording'), or a .csv table with one row per session. The table has a column 'recording' and,
        optionally, 'session', 'subject', and options of 'anchorpose track' such as 'height', 'patient' or 'smooth'.
    out
        The folder to write: a results folder for each session in 'sessions', tables, and index.html.
    workers
        How many sessions are tracked at once; by default one per core. Each takes up to 1 GB of memory.
    scheduler
        The address of a running dask scheduler, for example tcp://10.0.0.5:8786, or 'slurm'; by default, sessions run
        on this machine.
    slurm
        A TOML file for '--scheduler slurm' with the resources of a job: queue, account, memory, walltime and other
        options of dask_jobqueue.SLURMCluster.
    index
        Track only the session with this number, counted from 0, for a job array of any scheduler. After all jobs, run
        the command with --summary.
    summary
        Track nothing; write the tables and the page from existing results.
    config
        A TOML or JSON settings file: settings of tracking for all recordings, and defaults for these options in its
        table [batch].
    smooth
        Track all recordings backward in time as well, as 'anchorpose track --smooth'.
    """
    from anchorpose.batch.cluster import CONNECT_S, SLURM, Place
    from anchorpose.batch.sessions import find_sessions
    from anchorpose.batch.tracking import run_batch, run_one, summarise
    from anchorpose.recording.document import read_toml
    from anchorpose.recording.writable import check_place

    check_place(out)
    if not recordings:
        raise InputError(out, "was given no recordings", "give recordings, folders, patterns or a .csv table")
    place = Place(workers, scheduler, {} if slurm is None else read_toml(slurm))
    options = TrackOptions(config=config, smooth=smooth)
    options.settings()  # raises an error for a mistake in the settings file, once, before any session begins
    sessions = find_sessions(recordings, options)
    if index is not None and not summary:
        row = run_one(sessions, out, index)
        say(f"{row.session}: {row.state}. {row.why or ''}".strip())
        return EXIT_FAILED if row.why else 0
    try:
        if not summary and place.scheduler is not None and place.scheduler != SLURM:
            say(f"Asking the scheduler at {place.scheduler}, for {CONNECT_S:g} s at most.")
        with nullcontext() if summary else progress_bar("Sessions") as progress:
            rows = summarise(sessions, out) if progress is None else run_batch(sessions, out, place, progress)
    except KeyboardInterrupt as stopped:
        stopped.add_note("What was done is kept: the same command goes on from here.")
        raise
    for row in rows:
        if row.why:
            say(f"{row.session}: {row.why}")
    counts = Counter(row.state for row in rows)
    states = ", ".join(f"{count} {state}" for state, count in counts.items())
    say(f"{states}. Open {out / 'index.html'} in a browser.")
    return EXIT_FAILED if counts["failed"] else 0
