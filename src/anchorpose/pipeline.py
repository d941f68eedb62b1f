"""From a recording folder to a results folder: the order of the stages.

recording -> calibration -> isolation -> surface -> geodesics -> association -> tracking -> body -> results -> report

The room is prepared once; then every frame goes through ``tracker.observation`` (isolation to descriptor) and
``tracker.patient`` (association to body). The patient's body is learnt on a first pass over the first seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anchorpose.body.regions import area_of_point, region_of_points
from anchorpose.body.skin_points import body_points
from anchorpose.calibration.calibration import PoseSource
from anchorpose.calibration.clock.clocks import Clocks
from anchorpose.calibration.clock.settled import clock_notes
from anchorpose.recording.calibration_file import with_poses
from anchorpose.recording.gaps import CameraGaps, find_gaps
from anchorpose.recording.inputs import input_files
from anchorpose.recording.reader import frame_range, open_recording
from anchorpose.recording.recording import Recording
from anchorpose.recording.subject import with_height
from anchorpose.report.page import write_report
from anchorpose.results.body_record import record_body
from anchorpose.results.contact_intervals import ContactIntervals
from anchorpose.results.contacts import CONTACTS_FILE, write_contacts
from anchorpose.results.measuring import write_measured
from anchorpose.results.pictures import FramePicture, save_pictures
from anchorpose.results.processing.policy import ProcessingConfig
from anchorpose.results.run_record import (
    RUN_FILE,
    Association,
    CameraRecord,
    DroppedFrame,
    Residual,
    RunRecord,
    StageTiming,
    hash_files,
    write_run_record,
)
from anchorpose.results.stand_training.measure import MeasureConfig
from anchorpose.results.tables import JOINTS_FILE, write_joints
from anchorpose.threads import one_thread
from anchorpose.tracker.both_ways import FrameRecord, learn_on, plan_route, track_on
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.learning import LearntPatient
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Room
from anchorpose.tracker.stopwatch import Stopwatch
from anchorpose.tracking.motion_file import load_motions

__all__ = ["TrackConfig", "track_recording"]

PICTURES = 6  # frames shown in the report, spread over the recording

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class _Written:
    """What the pass over all frames leaves behind besides the table."""

    association: Association
    dropped: tuple[DroppedFrame, ...]
    pictures: tuple[FramePicture, ...]


def track_recording(
    recording: Path, results: Path, config: TrackConfig, progress: Progress, calibration: Path | None = None
) -> None:
    """Track the patient through a recording and write everything into an existing, empty results folder.

    progress is called with frames done and frames to do; the frames the body is learnt from count twice. calibration: a
    calibration.json whose poses are used instead of given or found ones.
    Linear algebra runs on one thread: on several, sums are added in another order, and the tables get other bytes.
    Raises InputError where the recording cannot be used.
    """
    with one_thread():
        _track(recording, results, config, progress, calibration)


def _track(recording: Path, results: Path, config: TrackConfig, progress: Progress, calibration: Path | None) -> None:
    watch = Stopwatch()
    opened = with_height(open_recording(recording), config.height_m)
    if calibration is not None:
        opened = with_poses(opened, calibration)
    frame_range(opened, config.start, config.stop)  # refuses an empty range before any work is done
    motions = load_motions(config.motion_file, opened.rate_hz, config.motion)  # likewise a file that is none
    total, window = _frame_counts(opened, config)
    with watch.stage("calibration and background"):
        room = prepare_room(opened, config)
    work = window + total * (2 if config.smooth else 1)
    route = plan_route(room, config, _counter(progress, work))
    learnt = learn_on(route, room, motions, config, watch)
    shape = None if learnt is None else learnt.shape
    shown = set(np.unique(np.linspace(config.start, config.start + total - 1, PICTURES).astype(int)).tolist())
    written = _write_frames(results, track_on(route, room, motions, shape, shown, config, watch), config)
    with watch.stage("results"):
        write_measured(results, ProcessingConfig(), MeasureConfig())
        _write_record(results, room, written, learnt, config, watch, calibration)
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


def _write_frames(results: Path, records: Iterable[FrameRecord], config: TrackConfig) -> _Written:
    """Stream joints and contacts to their tables; keep pictures and problems."""
    dropped, pictures, shares = list[DroppedFrame](), list[FramePicture](), list[float | None]()
    points = body_points()
    intervals = ContactIntervals(region_of_points(points), area_of_point(points), config.contacts)
    with write_joints(results / JOINTS_FILE) as table, write_contacts(results / CONTACTS_FILE) as contacts:
        for record in records:
            table.append(record.joints)
            frame, time_s = record.joints.frame, record.joints.time_s
            for contact in intervals.push(frame, time_s, record.near):
                contacts.append(contact)
            dropped += [DroppedFrame(frame, time_s, why) for why in record.problems]
            pictures += record.pictures
            shares.append(None if record.matched_share is None else round(record.matched_share, 3))
        for contact in intervals.finish():
            contacts.append(contact)
    return _Written(Association(tuple(shares)), tuple(dropped), tuple(pictures))


def _write_record(
    results: Path, room: Room, written: _Written, learnt: LearntPatient | None, config: TrackConfig, watch: Stopwatch,
    calibration_file: Path | None,
) -> None:  # fmt: skip
    calibration, gaps = room.calibration, find_gaps(room.recording)
    movements = config.motion_file
    source = None if calibration_file is None else PoseSource.FILE
    record = RunRecord(
        recording=room.recording.folder.resolve().name,
        config=config,
        inputs_sha256=(
            *hash_files(input_files(room.recording), room.recording.folder),
            *(hash_files([movements], movements.parent) if config.motion.uses_database else ()),
        ),
        cameras=tuple(
            CameraRecord(camera.name, camera.T_world_camera, (source or pose.source).value)
            for camera, pose in zip(room.cameras, calibration.poses, strict=True)
        ),
        residuals=(
            *(
                Residual(floor.camera, "floor, rms distance to the plane", floor.residual_m, "m")
                for floor in calibration.residuals
            ),
            *(
                Residual(pose.camera, figure.what, figure.value, figure.unit)
                for pose in calibration.poses
                for figure in pose.figures
            ),
            *_clock_residuals(room.clocks, gaps),
        ),
        timings=tuple(StageTiming(stage, seconds) for stage, seconds in watch.seconds.items()),
        frame_count=len(written.association.matched_share),
        association=written.association,
        dropped=written.dropped,
        body=None if learnt is None else record_body(body_points().asset, learnt.belief, learnt.first, learnt.seconds),
        pictures=save_pictures(results, written.pictures),
        notes=(
            *calibration.notes,
            *clock_notes(room.clocks),
            *(camera.sentence for camera in gaps if camera.sentence),
            *_notes(room, learnt),
            *written.association.sentences,
        ),
    )
    write_run_record(results / RUN_FILE, record)


def _clock_residuals(clocks: Clocks, gaps: Sequence[CameraGaps]) -> list[Residual]:
    """What was measured of each camera's clock, the first camera's being the reference."""
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


def _notes(room: Room, learnt: LearntPatient | None) -> list[str]:
    """Sentences on who was tracked and with which body."""
    if room.opening is None:
        return ["nobody was seen in the sampled frames, so no joint could be tracked"]
    choice = room.opening.choice
    x, z = choice.ground_xz_m
    notes = [
        f"the patient was taken to be the person at x {x:.2f} m, z {z:.2f} m in frame {room.opening.frame}, "
        f"who {choice.reason}; tracking goes from there to both ends"
    ]
    if learnt is None:
        notes.append("no body could be fitted to this person, so no joint could be tracked")
    else:
        notes.append(f"the learnt clothes are {1000 * learnt.shape.clothing_m:.0f} mm thick")
    return notes
