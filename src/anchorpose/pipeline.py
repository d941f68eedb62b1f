"""From a recording folder to a results folder: the stages in their order.

recording -> calibration -> isolation -> surface -> geodesics -> association -> tracking -> body -> results -> report

``track_recording`` is the order of the work; what happens to a single frame is ``tracker.patient.PatientTracker.step``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from anchorpose.body.contact_regions import area_of_point, region_of_points
from anchorpose.body.skin_points import body_points
from anchorpose.pages.frame_pictures import draw_chosen, save_pictures
from anchorpose.recording.recording import Recording
from anchorpose.report.page import write_report
from anchorpose.results.contact_intervals import ContactIntervals
from anchorpose.results.explained import EXPLAINED_FILE, read_explained, summarise, write_explained
from anchorpose.results.measuring import write_measured
from anchorpose.results.people_labels import PEOPLE_FILE, write_people
from anchorpose.results.poor_intervals import PoorInterval, note_poor
from anchorpose.results.poses import POSES_FILE, write_poses
from anchorpose.results.processing.process import ProcessingConfig
from anchorpose.results.records import CONTACTS_FILE, write_contacts
from anchorpose.results.run_record import (
    RUN_FILE,
    DroppedFrame,
    LostInterval,
    MatchedShares,
    note_lost,
    write_run_record,
)
from anchorpose.results.stand_training.measure import MeasureConfig
from anchorpose.results.tables import ANCHORS_FILE, JOINTS_FILE, read_joints, write_anchors, write_joints
from anchorpose.results.unfinished import begin_journal, end_journal
from anchorpose.run_account import Written, account_of, outcome_of
from anchorpose.threads import one_thread
from anchorpose.track_inputs import UserInputs, read_inputs
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.journal import Journal
from anchorpose.tracker.passes import TrackedFrame, learn_on, plan_route, track_on
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.prior_shape import is_human
from anchorpose.tracker.run import Run, Stopwatch
from anchorpose.tracker.start import NoStart
from anchorpose.tracking.motion_file import load_motions

__all__ = ["TrackConfig", "track_recording"]

Progress = Callable[[int, int], None]


def track_recording(
    recording: Path,
    results: Path,
    config: TrackConfig,
    progress: Progress,
    calibration: Path | None = None,
    corrections: Path | None = None,
) -> None:
    """Track the patient through a recording and write everything into an existing results folder.

    It is empty, or holds the journal of a run that was stopped: then tracking goes on where that one ended, and ends
    with the same tables.

    progress is called with frames done and frames to do; the frames the body is learnt from count twice. calibration: a
    calibration.json whose poses replace given or found ones. corrections: a reviewer's corrections of earlier results.
    Linear algebra runs on one thread: on several, sums are added in another order, and the tables get other bytes.
    Raises InputError where the recording cannot be used.
    """
    with one_thread():
        _track(recording, results, config, progress, UserInputs(calibration, corrections))


def _track(folder: Path, results: Path, config: TrackConfig, progress: Progress, user: UserInputs) -> None:
    # recording: everything is read and checked before any work is done
    inputs = read_inputs(folder, config, user)
    recording, config = inputs.recording, inputs.config
    begun = begin_journal(results, inputs.identity, dict(inputs.sha256))
    motions = load_motions(config.motion_file, recording.rate_hz, config.motion)
    total, first_pass = _frame_counts(recording, config)
    work = first_pass + total * (3 if config.smooth else 1)

    # calibration and isolation: clocks, camera poses, the empty room, and who is the patient
    stopwatch = Stopwatch()
    with stopwatch.stage("calibration and background"):
        room = prepare_room(recording, config, inputs.review)
    run, route = Run(room, config, motions, stopwatch), plan_route(room, config, _counter(progress, work))
    journal = Journal(begun, {"run": run, "room": room, "points": body_points(), "asset": body_points().asset})

    # body: the patient's own shape, from a first pass over the first seconds
    learnt = journal.once("learnt", lambda: learn_on(route, run))
    if learnt is not None and not (recording.subject.height_m or is_human(learnt.shape)):
        learnt, run = None, run.without_patient(NoStart.NOT_HUMAN)
        journal = replace(journal, shared={**journal.shared, "run": run, "room": run.room})
    shape = None if learnt is None else learnt.shape

    # every frame: isolation, surface, geodesics, association, tracking, body
    written = _write_frames(results, track_on(route, run, shape, journal), config)

    # results and report
    with stopwatch.stage("results"):
        write_measured(results, ProcessingConfig(), MeasureConfig())
        pictures = save_pictures(results, draw_chosen(results, room, shape, config.surface))
        given = inputs.review_file
        outcome = None if given is None else outcome_of(given, read_joints(results / JOINTS_FILE))
        account = account_of(run, written, pictures, learnt, inputs, outcome)
        write_run_record(results / RUN_FILE, account)
        write_report(results)
    end_journal(results)
    progress(work, work)


def _frame_counts(recording: Recording, config: TrackConfig) -> tuple[int, int]:
    """Frames to track, and about how many are read beforehand to learn the body."""
    time_s = recording.streams[0].time_s[config.start : config.stop]
    return len(time_s), int((time_s <= time_s[0] + config.learning.window_s).sum())


def _counter(progress: Progress, total: int) -> Callable[[], None]:
    """Reports one more frame at each call."""
    done = 0

    def tick() -> None:
        nonlocal done
        done = min(done + 1, total)
        progress(done, total)

    return tick


def _write_frames(results: Path, frames: Iterable[TrackedFrame], config: TrackConfig) -> Written:
    """Stream joints, poses, what they explain, anchors, labels and contacts to their tables; collect problems."""
    dropped, lost, shares = list[DroppedFrame](), list[LostInterval](), list[float | None]()
    poor = list[PoorInterval]()
    points = body_points()
    intervals = ContactIntervals(region_of_points(points), area_of_point(points), config.contacts)
    with (
        write_joints(results / JOINTS_FILE) as table,
        write_poses(results / POSES_FILE) as poses,
        write_explained(results / EXPLAINED_FILE) as explained,
        write_anchors(results / ANCHORS_FILE) as anchors,
        write_people(results / PEOPLE_FILE) as people,
        write_contacts(results / CONTACTS_FILE) as contacts,
    ):
        for tracked in frames:
            record = tracked.record
            for labels in tracked.labels:
                people.append(labels)
            table.append(record.joints)
            poses.append(record.body)
            explained.append(record.explained)
            anchors.append(record.anchors)
            frame, time_s = record.joints.frame, record.joints.time_s
            for contact in intervals.push(frame, time_s, record.near):
                contacts.append(contact)
            dropped += [DroppedFrame(frame, time_s, why) for why in record.problems]
            note_lost(lost, frame, time_s, record.why_lost)
            note_poor(poor, frame, time_s, record.poor)
            shares.append(None if record.matched_share is None else round(record.matched_share, 3))
        for contact in intervals.finish():
            contacts.append(contact)
    summary = summarise(read_explained(results / EXPLAINED_FILE))
    return Written(MatchedShares(tuple(shares)), tuple(dropped), tuple(lost), tuple(poor), summary)
