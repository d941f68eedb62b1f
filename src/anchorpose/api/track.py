"""Track a whole recording, given as a folder or as arrays, with one call, as ``anchorpose track`` does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from anchorpose.api.arrays import DepthImages
from anchorpose.api.recording_input import Watcher, as_recording
from anchorpose.api.results import Results
from anchorpose.tracker.config import TrackConfig


@dataclass(frozen=True, slots=True)
class Options:
    """Options of tracking, with the names and meanings of the options of ``anchorpose track``; None means that an
    option is not given.
    """

    config: TrackConfig | None = None
    calibration: Path | str | None = None
    corrections: Path | str | None = None
    events: Path | str | None = None
    overwrite: bool = False
    resume: bool = False
    threads: int = 1


def track(
    recording: Path | str | DepthImages,
    results: Path | str | None = None,
    *,
    config: TrackConfig | None = None,
    calibration: Path | str | None = None,
    corrections: Path | str | None = None,
    events: Path | str | None = None,
    overwrite: bool = False,
    threads: int = 1,
) -> Results:
    """Find the patient's 21 joints in every frame of a recording, and open the results.

    recording: a recording folder, a recorder's file, or depth images in memory. results: the folder to write, which
    appears when tracking is complete; if None, the results are in a temporary folder that exists as long as the
    returned object. config: settings that differ from the defaults. The other arguments mean the same as the options of
    the command ``anchorpose track``. Raises InputError if the recording cannot be used, or the folder exists and may
    not be overwritten.
    """
    options = Options(config, calibration, corrections, events, overwrite, threads=threads)
    return track_watched(recording, results, options, Watcher())


def track_watched(
    recording: Path | str | DepthImages, results: Path | str | None, options: Options, watcher: Watcher
) -> Results:
    """Track a recording as ``track`` does, and report progress and notes to ``watcher``."""
    from anchorpose.pipeline import track_recording
    from anchorpose.results.folder import check_results_path
    from anchorpose.results.unfinished import RESUME, unfinished_results

    calibration, corrections, events = (
        None if path is None else Path(path) for path in (options.calibration, options.corrections, options.events)
    )
    with TemporaryDirectory(prefix="anchorpose-") as own:
        source = recording.write(Path(own)) if isinstance(recording, DepthImages) else Path(recording)
        kept = TemporaryDirectory(prefix="anchorpose-results-") if results is None else None
        target = Path(results) if kept is None else Path(kept.name) / "results"  # type: ignore[arg-type]
        check_results_path(target, source, options.overwrite)
        source = source if isinstance(recording, DepthImages) else as_recording(source, watcher)
        work = unfinished_results(target, source, options.overwrite, options.resume, watcher.how_to_resume or RESUME)
        with work as folder, watcher.working("Tracking") as progress:
            config = options.config or TrackConfig()
            track_recording(source, folder, config, progress, calibration, corrections, options.threads, events)
    return Results(target, kept)


def open_results(results: Path | str) -> Results:
    """Open a results folder; raises InputError if it is not a results folder."""
    return Results(Path(results))
