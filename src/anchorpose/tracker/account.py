"""What run.json tells of a tracked recording: inputs, cameras, residuals, and sentences on who was tracked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from anchorpose.body.skin_points import body_points
from anchorpose.calibration.calibration import PoseSource
from anchorpose.calibration.clock.clocks import Clocks
from anchorpose.calibration.clock.settled import clock_notes
from anchorpose.recording.gaps import CameraGaps, find_gaps
from anchorpose.recording.inputs import input_files
from anchorpose.results.body_record import record_body
from anchorpose.results.corrections import Corrections, require_recording
from anchorpose.results.reviewed_recording import poses_of, reviewed_recording
from anchorpose.results.run_record import (
    Association,
    CameraRecord,
    CorrectionsRecord,
    DroppedFrame,
    PictureRecord,
    Residual,
    RunRecord,
    StageTiming,
    hash_files,
)
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.learning import LearntPatient
from anchorpose.tracker.review import require_frames
from anchorpose.tracker.room import Room
from anchorpose.tracker.stopwatch import Stopwatch


@dataclass(frozen=True, slots=True, eq=False)
class Written:
    """What the pass over all frames leaves behind besides the tables."""

    association: Association
    dropped: tuple[DroppedFrame, ...]


@dataclass(frozen=True, slots=True)
class Given:
    """Files that the user gives besides the recording; None for what is not given."""

    calibration: Path | None = None
    corrections: Path | None = None


def hash_inputs(room: Room, config: TrackConfig) -> tuple[tuple[str, str], ...]:
    """(path, hash) of every file of the recording and of the reference movements."""
    movements = config.motion_file
    return (
        *hash_files(input_files(room.recording), room.recording.folder),
        *(hash_files([movements], movements.parent) if config.motion.uses_database else ()),
    )


def corrections_for(
    path: Path, corrections: Corrections, room: Room, inputs_sha256: tuple[tuple[str, str], ...]
) -> CorrectionsRecord:
    """What is recorded of the corrections read from ``path``.

    Raises InputError where they are about another recording, another world or frames that there are not.
    """
    name = room.recording.folder.resolve().name
    require_recording(path, corrections, reviewed_recording(name, inputs_sha256, poses_of(room.cameras)))
    require_frames(path, room.review, room.recording)
    ((_, digest),) = hash_files([path], path.parent)
    return CorrectionsRecord(path.name, digest, corrections.unusable, corrections.joints)


def account_of(
    room: Room, written: Written, pictures: tuple[PictureRecord, ...], learnt: LearntPatient | None,
    config: TrackConfig, watch: Stopwatch, given: Given, inputs_sha256: tuple[tuple[str, str], ...],
    corrections: CorrectionsRecord | None,
) -> RunRecord:  # fmt: skip
    """The record of a run that has been through all frames."""
    calibration, gaps = room.calibration, find_gaps(room.recording)
    source = None if given.calibration is None else PoseSource.FILE
    return RunRecord(
        recording=room.recording.folder.resolve().name,
        config=config,
        inputs_sha256=inputs_sha256,
        corrections=corrections,
        cameras=tuple(
            CameraRecord(camera.name, camera.T_world_camera, (source or pose.source).value, clock.clock)
            for camera, pose, clock in zip(room.cameras, calibration.poses, room.clocks.cameras, strict=True)
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
        pictures=pictures,
        notes=(
            *calibration.notes,
            *clock_notes(room.clocks),
            *(camera.sentence for camera in gaps if camera.sentence),
            *_notes(room, learnt),
            *written.association.sentences,
        ),
    )


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
