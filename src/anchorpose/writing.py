"""From tracked frames to a finished results folder: tables, angles and measures, pictures, run.json, the report."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from anchorpose.body.contact_regions import area_of_point, region_of_points
from anchorpose.body.skin_points import body_points
from anchorpose.pages.frame_pictures import draw_chosen, save_pictures
from anchorpose.report.page import REPORT_FILE, write_report
from anchorpose.results.contact_intervals import ContactIntervals
from anchorpose.results.event_log import add_event
from anchorpose.results.explained import EXPLAINED_FILE, read_explained, summarise, write_explained
from anchorpose.results.measuring import MeasureConfig, write_measured
from anchorpose.results.people_labels import PEOPLE_FILE, write_people
from anchorpose.results.poor_intervals import PoorInterval, note_poor
from anchorpose.results.processing import ProcessingConfig
from anchorpose.results.records import CONTACTS_FILE, write_contacts
from anchorpose.results.run_record import (
    RUN_FILE,
    DroppedFrame,
    LostInterval,
    MatchedShares,
    note_lost,
    write_run_record,
)
from anchorpose.results.tables import (
    ANCHORS_FILE,
    JOINTS_FILE,
    POSES_FILE,
    read_joints,
    write_anchors,
    write_joints,
    write_poses,
)
from anchorpose.run_account import Written, account_of, outcome_of
from anchorpose.track_inputs import TrackInputs
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.frame_record import TrackedFrame
from anchorpose.tracker.learning_pass import LearntPatient
from anchorpose.tracker.room import Run


def write_results(
    results: Path, frames: Iterable[TrackedFrame], run: Run, learnt: LearntPatient | None, inputs: TrackInputs
) -> None:
    """Write everything that ``frames``, in the order of time, become into an existing folder.

    Pictures show frames whose depth images the run's recording has. learnt: the patient's body, None without one.
    """
    written = _write_frames(results, frames, run.config)
    shape = None if learnt is None else learnt.shape
    with run.stage("results"):
        write_measured(results, ProcessingConfig(), MeasureConfig())
        pictures = save_pictures(results, draw_chosen(results, run.room, shape, run.config.surface))
        given = inputs.review_file
        outcome = None if given is None else outcome_of(given, read_joints(results / JOINTS_FILE))
        account = account_of(run, written, pictures, learnt, inputs, outcome)
        write_run_record(results / RUN_FILE, account)
        write_report(results)
        add_event(results, "track", (RUN_FILE, REPORT_FILE), about={"recording": account.recording})


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
