"""Run the stages in their order: from a recording folder to a results folder, or to calibration.json and pictures.

recording -> calibration -> isolation -> surface -> geodesics -> association -> tracking -> body -> results -> report

``track_recording`` shows the order of the work, ``tracker.patient.PatientTracker.step`` the work on a single frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from anchorpose.body.skin_points import body_points
from anchorpose.calibration.calibration import Calibration, PoseRecord, write_calibration
from anchorpose.calibration.first_frames import noise_per_m, what_stays
from anchorpose.calibration.markers import place_by_markers, read_marker_layout
from anchorpose.motion.prediction import load_motions
from anchorpose.pages.canvas import as_png
from anchorpose.pages.stage_drawing import draw_model
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import Recording, depths_of
from anchorpose.results.folder import BEGUN_FILE, begin_journal, clear_beside_journal, end_journal
from anchorpose.threads import one_thread, worker_threads
from anchorpose.track_inputs import UserInputs, read_inputs
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.journal import Journal
from anchorpose.tracker.learning_pass import LearntPatient
from anchorpose.tracker.passes import learn_on, plan_route, track_on
from anchorpose.tracker.preparation import prepare_room, settle
from anchorpose.tracker.prior_shape import is_human
from anchorpose.tracker.room import Run
from anchorpose.tracker.start import NoStart
from anchorpose.tracker.stopwatch import Stopwatch
from anchorpose.writing import write_results

__all__ = ["TrackConfig", "calibrate_recording", "track_recording"]

Progress = Callable[[int, int], None]


def track_recording(
    recording: Path,
    results: Path,
    config: TrackConfig,
    progress: Progress,
    calibration: Path | None = None,
    corrections: Path | None = None,
    threads: int = 1,
    events: Path | None = None,
) -> None:
    """Track the patient through a recording and write everything into an existing results folder.

    The folder is empty, or holds the journal of a stopped run: then tracking is resumed, and the tables are the same as
    without the stop.

    progress is called with the number of frames done and to do; frames from which the body is learnt count twice.
    calibration: a calibration.json whose poses replace the given or found poses. corrections: a reviewer's corrections
    of earlier results. events: an events.tsv with the trials, in place of the recording's own. threads: number of
    threads that share the cameras, people and trials of a frame; the tables have the same bytes with any number. Linear
    algebra runs on one thread, since several would add sums in another order. Raises InputError if the recording
    cannot be used.
    """
    with one_thread(), worker_threads(threads):
        _track(recording, results, config, progress, UserInputs(calibration, corrections, events))


def _track(folder: Path, results: Path, config: TrackConfig, progress: Progress, user: UserInputs) -> None:
    # recording: everything is read and checked before any work is done
    inputs = read_inputs(folder, config, user)
    recording, config = inputs.recording, inputs.config
    begun = begin_journal(results, inputs.identity, dict(inputs.sha256))
    Journal(begun).require_whole((BEGUN_FILE,))
    motions = load_motions(config.motion_file, recording.rate_hz, config.motion)
    total, first_pass = _frame_counts(recording, config)
    work = first_pass + total * (3 if config.smooth else 1)

    # calibration and isolation: clocks, camera poses, the empty room, and who is the patient
    stopwatch = Stopwatch()
    with stopwatch.stage("calibration and background"):
        room = prepare_room(recording, config, inputs.review)
    run, route = Run(room, config, motions, stopwatch), plan_route(room, config, _counter(progress, work))
    points = body_points()
    shared = {
        "run": run,
        "room": room,
        "config": config,
        "stopwatch": stopwatch,
        "points": points,
        "asset": points.asset,
    }
    journal = Journal(begun, shared)

    # body: the patient's own shape, from a first pass over the first seconds
    learnt = journal.once("learnt", LearntPatient | None, lambda: learn_on(route, run))
    if learnt is not None and not (recording.subject.height_m or is_human(learnt.shape)):
        learnt, run = None, run.without_patient(NoStart.NOT_HUMAN)
        journal = replace(journal, shared={**journal.shared, "run": run, "room": run.room})

    # every frame: isolation, surface, geodesics, association, tracking, body; then results and report
    frames = track_on(route, run, learnt, journal)
    clear_beside_journal(results)
    write_results(results, frames, run, learnt, inputs)
    end_journal(results)
    progress(work, work)


def _frame_counts(recording: Recording, config: TrackConfig) -> tuple[int, int]:
    """Return the number of frames to track, and the approximate number of frames that are read before tracking to learn
    the body.
    """
    time_s = recording.streams[0].time_s[config.start : config.stop]
    return len(time_s), int((time_s <= time_s[0] + config.learning.window_s).sum())


def _counter(progress: Progress, total: int) -> Callable[[], None]:
    """Return a function that reports one more frame at each call."""
    done = 0

    def tick() -> None:
        nonlocal done
        done = min(done + 1, total)
        progress(done, total)

    return tick


def calibrate_recording(
    recording: Path, folder: Path, config: TrackConfig, ignore_given: bool = False, markers: Path | None = None
) -> Calibration:
    """Find every camera's pose and write calibration.json and one picture per camera into an existing folder.

    ignore_given: find also the poses that the recording gives. markers: a markers.json; cameras with an image of the
    markers are placed by them, and the poses of the other cameras are found in the same world. Raises InputError if
    the recording cannot be used or a pose is not accepted.
    """
    with one_thread():
        opened = open_recording(recording)
        if ignore_given:
            opened = replace(opened, cameras=tuple(replace(c, T_world_camera=None) for c in opened.cameras))
        by_marker: dict[str, PoseRecord] = {}
        if markers is not None:
            opened, by_marker = place_by_markers(opened, read_marker_layout(markers))
        settled = settle(opened, config)
        found, samples = settled.calibration, settled.samples
        records = tuple(by_marker.get(pose.camera, pose) for pose in found.poses)
        calibration = replace(found, poses=records, notes=(*opened.notes, *found.notes))
        write_calibration(folder, opened.folder.resolve().name, calibration)
        for index, camera in enumerate(calibration.cameras):
            seen = depths_of(samples, index)
            background = opened.backgrounds_m[index]
            if background is not None or seen:
                still = background if background is not None else what_stays(np.stack(seen), noise_per_m(seen))
                (folder / f"{camera.name}.png").write_bytes(
                    as_png(draw_model(camera, still, opened.equipment, axes=True))
                )
    return calibration
