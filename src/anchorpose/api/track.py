"""Track a whole recording, a folder or arrays, with one call. ``anchorpose track`` is a user of it."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from anchorpose.api.arrays import DepthImages
from anchorpose.api.recording_input import Watcher, as_recording
from anchorpose.api.results import Results
from anchorpose.tracker.config import TrackConfig


def track(
    recording: Path | str | DepthImages,
    results: Path | str | None = None,
    *,
    config: TrackConfig | None = None,
    calibration: Path | str | None = None,
    corrections: Path | str | None = None,
    events: Path | str | None = None,
    overwrite: bool = False,
    resume: bool = False,
    threads: int = 1,
    watcher: Watcher | None = None,
    how_to_resume: str | None = None,
) -> Results:
    """Find the patient's 21 joints in every frame of a recording, and open what was found.

    recording: a recording folder, a recorder's file, or depth images in memory. results: the folder to write, which is
    there once all is done; without one, results are kept for as long as the returned object lives. config: settings
    that differ from the defaults. calibration, corrections, events, overwrite, resume, threads: as the options of
    ``anchorpose track``. watcher: hears of progress. how_to_resume: words for the message of a run that is stopped.
    Raises InputError where the recording cannot be used, or the folder exists and is not to be overwritten.
    """
    from anchorpose.pipeline import track_recording
    from anchorpose.results.folder import RESUME, check_results_path, unfinished_results

    watcher = watcher or Watcher()
    given = None if calibration is None else Path(calibration), None if corrections is None else Path(corrections)
    trials = None if events is None else Path(events)
    with TemporaryDirectory(prefix="anchorpose-") as own:
        source = recording.write(Path(own)) if isinstance(recording, DepthImages) else Path(recording)
        kept = TemporaryDirectory(prefix="anchorpose-results-") if results is None else None
        target = Path(results) if kept is None else Path(kept.name) / "results"  # type: ignore[arg-type]
        check_results_path(target, source, overwrite)
        source = source if isinstance(recording, DepthImages) else as_recording(source, watcher)
        work = unfinished_results(target, source, overwrite, resume, how_to_resume or RESUME)
        with work as folder, watcher.working("Tracking") as progress:
            track_recording(source, folder, config or TrackConfig(), progress, *given, threads=threads, events=trials)
    return Results(target, kept)


def open_results(results: Path | str) -> Results:
    """Open a results folder; raises InputError where it is none."""
    return Results(Path(results))
