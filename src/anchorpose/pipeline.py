"""From a recording folder to a results folder: the order of the stages.

recording -> calibration -> isolation -> surface -> geodesics -> association -> tracking -> body -> results -> report

The room is prepared once; then every frame goes through ``tracker.observation`` (isolation to descriptor) and
``tracker.patient`` (association to body). The patient's body is learnt on a first pass over the first seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from anchorpose.body.contact_regions import area_of_point, region_of_points
from anchorpose.body.skin_points import body_points
from anchorpose.pages.frame_pictures import draw_chosen, save_pictures
from anchorpose.recording.format import with_height, with_poses
from anchorpose.recording.reader import frame_range, open_recording
from anchorpose.recording.recording import Recording
from anchorpose.report.page import write_report
from anchorpose.results.anchors_table import ANCHORS_FILE, write_anchors
from anchorpose.results.contact_intervals import ContactIntervals
from anchorpose.results.contacts import CONTACTS_FILE, write_contacts
from anchorpose.results.measuring import write_measured
from anchorpose.results.people_labels import PEOPLE_FILE, LabelPicture, write_people
from anchorpose.results.poses import POSES_FILE, write_poses
from anchorpose.results.processing.policy import ProcessingConfig
from anchorpose.results.run_record import RUN_FILE, Association, DroppedFrame, write_run_record
from anchorpose.results.stand_training.measure import MeasureConfig
from anchorpose.results.tables import JOINTS_FILE, read_joints, write_joints
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.passes import FrameRecord, learn_on, plan_route, track_on
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import NOTHING_SAID, review_of
from anchorpose.tracker.run_account import Given, Written, account_of, hash_inputs, outcome_of, read_said, require_about
from anchorpose.tracker.stopwatch import Stopwatch
from anchorpose.tracking.motion_file import load_motions

__all__ = ["TrackConfig", "track_recording"]

Progress = Callable[[int, int], None]


def track_recording(
    recording: Path, results: Path, config: TrackConfig, progress: Progress, calibration: Path | None = None,
    corrections: Path | None = None,
) -> None:  # fmt: skip
    """Track the patient through a recording and write everything into an existing, empty results folder.

    progress is called with frames done and frames to do; the frames the body is learnt from count twice. calibration: a
    calibration.json whose poses are used instead of given or found ones. corrections: a file of what a reviewer of
    earlier results said of this recording.
    Linear algebra runs on one thread: on several, sums are added in another order, and the tables get other bytes.
    Raises InputError where the recording cannot be used.
    """
    with one_thread():
        _track(recording, results, config, progress, Given(calibration, corrections))


def _track(recording: Path, results: Path, config: TrackConfig, progress: Progress, given: Given) -> None:
    watch = Stopwatch()
    opened = with_height(open_recording(recording), config.height_m)
    if given.calibration is not None:
        opened = with_poses(opened, given.calibration)
    said = None if given.corrections is None else read_said(given.corrections)
    frame_range(opened, config.start, config.stop)  # refuses an empty range before any work is done
    motions = load_motions(config.motion_file, opened.rate_hz, config.motion)  # likewise a file that is none
    total, window = _frame_counts(opened, config)
    with watch.stage("calibration and background"):
        room = prepare_room(opened, config, NOTHING_SAID if said is None else review_of(said.corrections))
    inputs = hash_inputs(room, config)
    if said is not None:
        require_about(said, room, inputs)
    work = window + total * (2 if config.smooth else 1)
    route = plan_route(room, config, _counter(progress, work))
    learnt = learn_on(route, room, motions, config, watch)
    shape = None if learnt is None else learnt.shape

    def track(keep_labels: Callable[[LabelPicture], None]) -> Iterator[FrameRecord]:
        return track_on(route, room, motions, shape, config, watch, keep_labels)

    written = _write_frames(results, track, config)
    with watch.stage("results"):
        write_measured(results, ProcessingConfig(), MeasureConfig())
        pictures = save_pictures(results, draw_chosen(results, room, shape, config.surface.sheet))
        reviewed = None if said is None else outcome_of(said, read_joints(results / JOINTS_FILE))
        account = account_of(room, written, pictures, learnt, config, watch, given, inputs, reviewed)
        write_run_record(results / RUN_FILE, account)
        write_report(results)
    progress(work, work)


def _frame_counts(recording: Recording, config: TrackConfig) -> tuple[int, int]:
    """Frames to track, and about how many are read beforehand to learn the body."""
    time_s = recording.streams[0].time_s[config.start : config.stop]
    return len(time_s), int((time_s <= time_s[0] + config.learning.window_s).sum())


def _counter(progress: Progress, total: int) -> Callable[[], None]:
    """Tells progress of one more frame at each call."""
    done = 0

    def tick() -> None:
        nonlocal done
        done = min(done + 1, total)
        progress(done, total)

    return tick


def _write_frames(
    results: Path, track: Callable[[Callable[[LabelPicture], None]], Iterator[FrameRecord]], config: TrackConfig
) -> Written:
    """Stream joints, poses, anchors, labels and contacts to their tables; keep problems."""
    dropped, shares = list[DroppedFrame](), list[float | None]()
    points = body_points()
    intervals = ContactIntervals(region_of_points(points), area_of_point(points), config.contacts)
    with (
        write_joints(results / JOINTS_FILE) as table,
        write_poses(results / POSES_FILE) as poses,
        write_anchors(results / ANCHORS_FILE) as anchors,
        write_people(results / PEOPLE_FILE) as people,
        write_contacts(results / CONTACTS_FILE) as contacts,
    ):
        for record in track(people.append):
            table.append(record.joints)
            poses.append(record.body)
            anchors.append(record.anchors)
            frame, time_s = record.joints.frame, record.joints.time_s
            for contact in intervals.push(frame, time_s, record.near):
                contacts.append(contact)
            dropped += [DroppedFrame(frame, time_s, why) for why in record.problems]
            shares.append(None if record.matched_share is None else round(record.matched_share, 3))
        for contact in intervals.finish():
            contacts.append(contact)
    return Written(Association(tuple(shares)), tuple(dropped))
