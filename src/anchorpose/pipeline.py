"""Run the stages in their order: from a folder with a recording to a folder with results, or to calibration.json and
pictures of the calibration.

recording -> descriptor -> calibration -> isolation -> surface -> geodesics -> motion -> body -> results -> report

``track_recording`` runs all stages; ``tracker.patient.PatientTracker.step`` does the work on a single frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from anchorpose.body.skin_points import body_points
from anchorpose.calibration.calibration import Calibration, PoseRecord, write_calibration
from anchorpose.calibration.first_frames import noise_per_m, what_stays
from anchorpose.calibration.marker_layout import MarkerLayout
from anchorpose.calibration.markers import place_by_markers
from anchorpose.motion.prediction import load_motions
from anchorpose.pages.canvas import as_png
from anchorpose.pages.stage_drawing import draw_model
from anchorpose.recording.document import read_document
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import Recording, depths_of
from anchorpose.results.unfinished import BEGUN_FILE, begin_journal, clear_beside_journal, end_journal
from anchorpose.threads import one_thread, worker_threads
from anchorpose.track_inputs import UserInputs, read_inputs
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.journal import Journal
from anchorpose.tracker.learning_pass import LearntPatient
from anchorpose.tracker.passes import learn_on, plan_route, track_on
from anchorpose.tracker.preparation import agreeing, nobody_named, prepare_room, scenes_of, settle
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

    The results folder is empty, or contains the journal (intermediate results) of a run that was stopped. Such a run is
    resumed, and its tables are the same as the tables of a run that was not stopped.

    progress is called with (done, total), two numbers of frames. A frame counts each time it is processed: for example
    twice if the patient's body is also learnt from it. calibration: a calibration.json whose camera poses replace the
    poses that the recording gives or that tracking would find. corrections: a file with a reviewer's corrections of
    earlier results of this recording. events: an events.tsv with the trials, which replaces the recording's own
    events.tsv. threads: number of threads that share the work on a frame (its cameras, people and tried poses); the
    tables have the same bytes with any number of threads. Linear algebra runs on one thread, since several threads
    would add the terms of a sum in a varying order and so change the last digits. Raises InputError if the recording
    cannot be used.
    """
    with one_thread(), worker_threads(threads):
        _track(recording, results, config, progress, UserInputs(calibration, corrections, events))


def _track(folder: Path, results: Path, config: TrackConfig, progress: Progress, user: UserInputs) -> None:
    # stage recording: read and check everything before any other work
    inputs = read_inputs(folder, config, user)
    recording, config = inputs.recording, inputs.config
    begun = begin_journal(results, inputs.identity, dict(inputs.sha256))
    Journal(begun).require_whole((BEGUN_FILE,))
    motions = load_motions(config.motion_file, recording.rate_hz, config.motion)
    total, first_pass = _frame_counts(recording, config)
    work = first_pass + total * (3 if config.smooth else 1)

    # stages descriptor, calibration and isolation: find clocks, camera poses, the empty room and the patient
    stopwatch = Stopwatch()
    with stopwatch.stage("calibration and background"):
        room = prepare_room(recording, config, inputs.review)
    if config.patient_xz_m is not None and not room.initial_frames:
        raise nobody_named(recording, room.scenes, config)
    run, tick = Run(room, config, motions, stopwatch), _counter(progress, work)
    points = body_points()
    objects = {"run": run, "room": room, "config": config, "stopwatch": stopwatch}
    shared = objects | {"points": points, "asset": points.asset}
    journal = Journal(begun, shared)

    # stage body: learn the shape of the patient's body in a first pass over up to three stretches of the recording
    learnt = journal.once("learnt", LearntPatient | None, lambda: learn_on(plan_route(room, config, tick), run))
    if learnt is not None and not (recording.subject.height_m or is_human(learnt.shape)):
        learnt, run = None, run.without_patient(NoStart.NOT_HUMAN)
    if learnt is not None:
        run = replace(run.with_learnt(learnt.belief), room=learnt.where_found(room))
    journal = replace(journal, shared={**journal.shared, "run": run, "room": run.room})

    # stages for every frame: descriptor, isolation, surface, geodesics, motion, body; then results and report
    frames = track_on(plan_route(run.room, config, tick), run, learnt, journal)
    clear_beside_journal(results)
    write_results(results, frames, run, learnt, inputs)
    end_journal(results)
    progress(work, work)


def _frame_counts(recording: Recording, config: TrackConfig) -> tuple[int, int]:
    """Return the number of frames to track, and the approximate number of frames that are read before tracking to learn
    the patient's body.
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
    """Find every camera's pose; write calibration.json and one picture per camera into an existing folder.

    ignore_given: whether to ignore the camera poses that the recording gives, and to find these poses too. markers: a
    markers.json; cameras with an image of the markers are placed by the markers, and the poses of the other cameras are
    found in the same world. Minor contradictions between the poses and the depth images are noted in the calibration; a
    given pose that cannot be correct is refused, as by ``track_recording``. Raises InputError if the recording cannot
    be used or a pose is not accepted.
    """
    with one_thread():
        opened = open_recording(recording)
        if ignore_given:
            opened = replace(opened, cameras=tuple(replace(c, T_world_camera=None) for c in opened.cameras))
        by_marker: dict[str, PoseRecord] = {}
        if markers is not None:
            opened, by_marker = place_by_markers(opened, read_document(markers, MarkerLayout))
        settled = settle(opened, config)
        found, samples = agreeing(settled, scenes_of(settled)).calibration, settled.samples
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
