"""Write a complete results folder from tracked frames: tables, angles and measures, pictures, run.json (the record of
the run), and the report.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from anchorpose.body.contact_regions import region_of_points
from anchorpose.body.inverse_kinematics import CONTRADICTED
from anchorpose.body.learning import bone_lengths
from anchorpose.body.shape_prior import ShapeBelief, standing_height
from anchorpose.body.skin_points import CLOTHES, body_points
from anchorpose.body.standing_off import standing_off
from anchorpose.calibration.calibration import Calibration, PoseSource
from anchorpose.calibration.clocks import Clocks, clock_notes
from anchorpose.isolation.scene import Scene
from anchorpose.joints import JOINT_INDEX
from anchorpose.pages.overlay import draw_chosen, save_pictures
from anchorpose.recording.events import RecordedSpan, span_of
from anchorpose.recording.recording import CameraGaps, Recording, find_gaps
from anchorpose.report.page import REPORT_FILE, write_report
from anchorpose.results.contact_intervals import ContactIntervals
from anchorpose.results.corrections import CorrectionsRecord, JointCorrection
from anchorpose.results.explained import EXPLAINED_FILE, ExplainedSummary, read_explained, summarise, write_explained
from anchorpose.results.measuring import MeasureConfig, write_measured
from anchorpose.results.processing import ProcessingConfig
from anchorpose.results.records import CONTACTS_FILE, PEOPLE_FILE, write_contacts, write_people
from anchorpose.results.run_record import (
    RUN_FILE,
    BodyRecord,
    BoneRecord,
    CameraRecord,
    DepthRecord,
    DroppedFrame,
    LostInterval,
    MatchedShares,
    PatientRecord,
    PictureRecord,
    PoorInterval,
    Residual,
    RunRecord,
    StageTiming,
    note_lost,
    note_poor,
    write_run_record,
)
from anchorpose.results.tables import (
    ANCHORS_FILE,
    JOINTS_FILE,
    POSES_FILE,
    JointTable,
    read_joints,
    write_anchors,
    write_joints,
    write_poses,
)
from anchorpose.results.verify import add_event
from anchorpose.track_inputs import ReviewFile, TrackInputs
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.frame_record import TrackedFrame
from anchorpose.tracker.learning_pass import LearntPatient
from anchorpose.tracker.preparation import MOVED
from anchorpose.tracker.prior_shape import SYSTEMATIC_M
from anchorpose.tracker.room import Room, Run


def write_results(
    results: Path, frames: Iterable[TrackedFrame], run: Run, learnt: LearntPatient | None, inputs: TrackInputs
) -> None:
    """Write all results of ``frames``, which come in the order of time, into an existing folder.

    Pictures are made only of frames that have depth images in the run's recording. learnt: the patient's learnt body;
    None if no body was learnt.
    """
    written = _write_frames(results, frames, run)
    shape = None if learnt is None else learnt.shape
    with run.stage("results"):
        write_measured(results, ProcessingConfig(), MeasureConfig(), inputs.trials)
        pictures = save_pictures(results, draw_chosen(results, run.room, shape, run.config.surface))
        given = inputs.review_file
        outcome = None if given is None else outcome_of(given, read_joints(results / JOINTS_FILE))
        account = account_of(run, written, pictures, learnt, inputs, outcome)
        write_run_record(results / RUN_FILE, account)
        write_report(results)
        add_event(results, "track", (RUN_FILE, REPORT_FILE), about={"recording": account.recording})


def _write_frames(results: Path, frames: Iterable[TrackedFrame], run: Run) -> Written:
    """Write, frame by frame, the tables of joints, poses, anchors, person labels and contacts, and the table that
    states how well each pose explains the depth images. Return the data for run.json.
    """
    dropped, lost, shares = list[DroppedFrame](), list[LostInterval](), list[float | None]()
    poor, before = list[PoorInterval](), None
    equipment = run.room.recording.part_names
    intervals = ContactIntervals(region_of_points(body_points()), run.config.contacts, equipment)
    with (
        write_joints(results / JOINTS_FILE) as table,
        write_poses(results / POSES_FILE) as poses,
        write_explained(results / EXPLAINED_FILE) as explained,
        write_anchors(results / ANCHORS_FILE) as anchors,
        write_people(results / PEOPLE_FILE) as people,
        write_contacts(results / CONTACTS_FILE, equipment) as contacts,
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
            for contact in intervals.push(frame, time_s, record.near, record.gaps):
                contacts.append(contact)
            dropped += [DroppedFrame(frame, time_s, why) for why in record.problems]
            note_lost(lost, before, frame, time_s, record.why_lost)
            note_poor(poor, before, frame, time_s, record.poor)
            before = frame
            shares.append(None if record.matched_share is None else round(record.matched_share, 3))
        for contact in intervals.finish():
            contacts.append(contact)
    summary = summarise(read_explained(results / EXPLAINED_FILE))
    return Written(MatchedShares(tuple(shares)), tuple(dropped), tuple(lost), tuple(poor), summary)


@dataclass(frozen=True, slots=True, eq=False)
class Written:
    """Data for run.json that are collected while the tables are written.

    association: per frame, the share of the followed nodes (points of the patient's surface) that were matched in the
    next frame; dropped: frames or depth images that were not used; lost: intervals in which the patient was not found;
    poor_depth: intervals in which a camera's depth is too poor to locate joints; explained: how well the poses explain
    the depth images.
    """

    association: MatchedShares
    dropped: tuple[DroppedFrame, ...]
    lost: tuple[LostInterval, ...]
    poor_depth: tuple[PoorInterval, ...]
    explained: ExplainedSummary


def outcome_of(given: ReviewFile, joints: JointTable) -> CorrectionsRecord:
    """Return the record of a reviewer's corrections for run.json, with a sentence on each joint that the reviewer
    corrected but that is not at its corrected position in the results.
    """
    corrections = given.corrections
    sentences = tuple(text for text in (_why_not(one, joints) for one in corrections.joints) if text)
    held = (corrections.unusable, corrections.joints, corrections.patient)
    return CorrectionsRecord(given.path.name, given.sha256, *held, sentences)


def _why_not(correction: JointCorrection, joints: JointTable) -> str | None:
    """Return a sentence on why a joint is not where the reviewer placed it; None if the joint is there, within the
    uncertainty.
    """
    said, joint = f"{correction.joint} in frame {correction.frame}", JOINT_INDEX[correction.joint]
    rows = np.flatnonzero(joints.frame == correction.frame)
    if not len(rows):
        return f"{said} was not corrected: the frame was not tracked"
    row = int(rows[0])
    if joints.lost[row].all():
        return f"{said} was not corrected: the patient was not found in this frame, or it was marked as unusable"
    if joints.lost[row, joint]:
        return f"{said} was not corrected: the joint is lost all the same"
    away_m = float(np.linalg.norm(joints.position_m[row, joint] - correction.position_m))
    if away_m <= CONTRADICTED * np.hypot(correction.sigma_m, joints.sigma_m[row, joint]):
        return None
    return f"{said} was not corrected: a body of this size stays {100 * away_m:.0f} cm away from the given place"


def account_of(
    run: Run,
    written: Written,
    pictures: tuple[PictureRecord, ...],
    learnt: LearntPatient | None,
    inputs: TrackInputs,
    corrections: CorrectionsRecord | None,
) -> RunRecord:
    """Return the content of run.json. The function is called after the tables of all frames were written; ``written``
    has the data that were collected meanwhile.
    """
    room, config, gaps = run.room, run.config, find_gaps(run.room.recording)
    return RunRecord(
        recording=room.recording.folder.resolve().name,
        config=config if config.motions is None else replace(config, motions=Path(config.motions).name),
        inputs_sha256=dict(inputs.sha256),
        identity=inputs.identity,
        patient=_patient(room),
        corrections=corrections,
        calibration=inputs.calibration,
        cameras=_cameras(room, inputs.pose_source),
        floor_height_m=room.calibration.floor_height_m,
        residuals=(*_pose_residuals(room.calibration), *_clock_residuals(room.clocks, gaps)),
        timings=tuple(StageTiming(stage, seconds) for stage, seconds in run.stopwatch.seconds.items()),
        recorded=_recorded(room.recording, config),
        frame_count=len(written.association.matched_share),
        association=written.association,
        dropped=written.dropped,
        lost=written.lost,
        poor_depth=written.poor_depth,
        explained=written.explained,
        body=None if learnt is None else _record_body(learnt),
        pictures=pictures,
        notes=(
            *room.recording.notes,
            *room.calibration.notes,
            *clock_notes(room.clocks),
            *(camera.sentence for camera in gaps if camera.sentence),
            *_about_depth(room),
            *room.notes,
            *_notes(room, learnt),
            *_unknown_height(run, learnt),
            *written.association.sentences,
            *(() if corrections is None else corrections.not_honoured),
        ),
    )


def _recorded(recording: Recording, config: TrackConfig) -> RecordedSpan | None:
    """Return the start and the end of the recording. Return None if the tracked frames show both, because all frames
    were tracked and the recording's first camera was not left out.
    """
    part = bool(config.start) or config.stop is not None or recording.left_out_s is not None
    return span_of(recording) if part else None


def _cameras(room: Room, source: PoseSource | None) -> tuple[CameraRecord, ...]:
    """Return each camera's record for run.json: the pose and the clock that were used, and where the pose comes from.
    source: where all poses come from if the user gave them, in a calibration file or with corrections; None otherwise.
    """
    return tuple(
        CameraRecord(camera.name, camera.T_world_camera, (source or pose.source).value, clock.clock, _depth(scene))
        for camera, pose, clock, scene in zip(
            room.cameras, room.calibration.poses, room.clocks.cameras, room.scenes, strict=True
        )
    )


def _depth(scene: Scene) -> DepthRecord:
    sensor = scene.background.sensor
    return DepthRecord(sensor.noise, sensor.step_per_m, sensor.edge_px)


def _pose_residuals(calibration: Calibration) -> list[Residual]:
    floor = "floor, rms distance to the plane"
    return [Residual(one.camera, floor, one.residual_m, "m") for one in calibration.residuals] + [
        Residual(pose.camera, each.what, each.value, each.unit) for pose in calibration.poses for each in pose.figures
    ]


def _clock_residuals(clocks: Clocks, gaps: Sequence[CameraGaps]) -> list[Residual]:
    """Return values that describe how well the cameras' clocks agree. For each camera after the first, they include the
    offset and the drift of its clock against the first camera's clock, with the standard errors of both, where known.
    """
    found = []
    for camera, missing in zip(clocks.cameras[1:], gaps[1:], strict=True):
        name, clock = camera.camera, camera.clock
        if camera.sigma_s is not None:
            found.append(
                Residual(name, f"clock, ahead of the first camera's at {clock.at_s:.1f} s", clock.ahead_s, "s")
            )
            found.append(Residual(name, "clock, standard error of that", camera.sigma_s, "s"))
        if camera.drift_sigma is not None:
            found.append(Residual(name, "clock, drift against the first camera's", clock.drift, "s/s"))
            found.append(Residual(name, "clock, standard error of the drift", camera.drift_sigma, "s/s"))
            found.append(Residual(name, "clock, lags measured with other cameras", float(camera.lags), "1"))
        found.append(Residual(name, "share of the first camera's frames with a picture", missing.paired_share, "1"))
    if clocks.residual_s is not None:
        found.append(Residual(clocks.cameras[0].camera, "clocks, rms of all lags", clocks.residual_s, "s"))
    return found


def _about_depth(room: Room) -> list[str]:
    """Return notes for the user: a sentence on the source of each camera's empty room, then a sentence on each camera
    that moved, on each camera whose filters blur depth edges, and on each camera whose noise was not measured.
    """
    moved = [f"camera {scene.camera.name} {MOVED}" for scene in room.scenes if scene.background.moved]
    rooms = [f"camera {scene.camera.name}, empty room: {scene.background.source.value}" for scene in room.scenes]
    sensors = [(f"camera {scene.camera.name}", scene.background.sensor) for scene in room.scenes]
    coarse = [
        f"{camera}: its filters draw depth edges out over {sensor.edge_px:.0f} pixels: farther than "
        f"{sensor.limbs_until_m:.1f} m from it an arm cannot be told from what is beside it"
        for camera, sensor in sensors
        if sensor.filtered
    ]
    return [*rooms, *moved, *coarse] + [
        f"{camera}: no still background is seen to measure its noise on; it is estimated from neighbouring readings, "
        "which does not show the errors that they share, so sigma may be too small"
        for camera, sensor in sensors
        if not sensor.noise.measured
    ]


def _patient(room: Room) -> PatientRecord | None:
    if room.initial_frame is None:
        return None
    choice, frame = room.initial_frame.choice, int(room.recording.streams[0].frame[room.initial_frame.frame])
    (x, z), rival = choice.ground_xz_m.tolist(), choice.rival_xz_m
    return PatientRecord(frame, (x, z), choice.reason, None if rival is None else (float(rival[0]), float(rival[1])))


def _notes(room: Room, learnt: LearntPatient | None) -> list[str]:
    """Return notes for the user that state which person was tracked, and which body was learnt for this person."""
    patient = _patient(room)
    if patient is None:
        return [f"no joint could be tracked: {room.why_nobody}"]
    x, z = patient.xz_m
    notes = [
        f"the patient was taken to be the person at x {x:.2f} m, z {z:.2f} m in frame {patient.frame}, "
        f"who {patient.reason}; tracking goes from there to both ends"
    ]
    if patient.rival_xz_m is not None:
        x, z = patient.rival_xz_m
        notes.append(
            f"the person at x {x:.2f} m, z {z:.2f} m may be the patient as well: look at the pictures, "
            f"and track again with --patient {x:.2f},{z:.2f} if so"
        )
    if learnt is None:
        notes.append("no body could be fitted to this person, so no joint could be tracked")
    else:
        thick = ", ".join(
            f"{piece} {1000 * thickness_m:.0f} mm"
            for piece, thickness_m in zip(CLOTHES, learnt.shape.offset_m.tolist(), strict=False)
        )
        notes.append(f"thickness of the learnt clothes: {thick}")
        if learnt.contradiction:
            notes.append(learnt.contradiction)
        if learnt.turned is not None:
            notes.append(
                "the images do not decide which way the patient faces, so sigma includes the other way; a second "
                "camera or the patient's height (--height) may decide"
            )
        stated = room.recording.subject.covered
        notes += [
            f"the visible skin of the patient's {part.replace('_', ' ')} is {1000 * away_m:.0f} mm off a human shape, "
            "more than clothes explain, so joints there are less certain: if a brace covers it, add "
            f'"covered": ["{part}"] to "subject" in recording.json'
            for part, away_m in standing_off(body_points(), learnt.shape).items()
            if part not in stated
        ]
    return notes


def _unknown_height(run: Run, learnt: LearntPatient | None) -> list[str]:
    """Return a note for the user if the images hardly determine the patient's height, and the user gave no height that
    agrees with the images; else no note.
    """
    if learnt is None or run.shape is None:
        return []
    if run.room.recording.subject.height_m is not None and not learnt.contradiction:
        return []
    height_m, sigma_m = _height(learnt.belief)
    if sigma_m <= SYSTEMATIC_M:
        return []
    return [
        f"the images do not show the patient's height well ({height_m:.2f} m, sigma {100 * sigma_m:.0f} cm), so sigma "
        "of the joints includes the error of a taller or shorter body: measure the height (--height), and place the "
        "camera so that it sees head, feet and floor"
    ]


def _height(belief: ShapeBelief) -> tuple[float, float]:
    """Return the standing height of a person with this body shape, and the standard deviation of this height, in
    metres.
    """
    height_m, row = standing_height(body_points().asset, belief.shape)
    return height_m, float(np.sqrt(belief.variance(row[None])[0]))


def _record_body(learnt: LearntPatient) -> BodyRecord:
    """Return the record of the learnt body for run.json. For each bone, the record also has the change of its length
    since the body was learnt from the first window (a few seconds of frames); later windows refine the body.
    """
    asset, belief = body_points().asset, learnt.belief
    height_m, sigma_m = _height(belief)
    return BodyRecord(
        learnt_from_s=learnt.seconds,
        height_m=height_m,
        height_sigma_m=sigma_m,
        clothes_m=dict(zip(CLOTHES, belief.shape.offset_m.tolist(), strict=False)),
        bones=tuple(
            BoneRecord(now.bone, now.length_m, now.sigma_m, now.length_m - before.length_m)
            for now, before in zip(bone_lengths(asset, belief), bone_lengths(asset, learnt.first), strict=True)
        ),
        coefficients=tuple(belief.shape.coefficients.tolist()),
    )
