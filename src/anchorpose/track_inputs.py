"""Read and check the inputs of ``track`` before any work: the recording, and the user's other files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from anchorpose.calibration.calibration import PoseSource
from anchorpose.errors import InputError
from anchorpose.recording.events import GIVEN, Trials, events_files, read_trials, sidecar_of, span_of
from anchorpose.recording.reader import frame_range, input_files, open_recording
from anchorpose.recording.recording import Recording
from anchorpose.recording.recording_file import calibration_file, with_height, with_poses
from anchorpose.recording.regular_file import is_there
from anchorpose.results.corrections import Corrections, NamedPatient, read_corrections, require_recording
from anchorpose.results.reviewed_recording import ReviewedCamera, reviewed_recording
from anchorpose.results.run_record import CalibrationUsed, as_json, hash_files
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.room import NO_REVIEW, Review, require_frames, review_of
from anchorpose.versions import code_digest, versions

# Maximum distance in m between two stated places of the patient that count as the same place; places are printed to the
# centimetre, so a copied place may differ by this much.
SAME_PLACE_M: Final = 0.01


@dataclass(frozen=True, slots=True)
class UserInputs:
    """Paths of the files that the user gives besides the recording; None if not given."""

    calibration: Path | None = None
    corrections: Path | None = None
    events: Path | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ReviewFile:
    """The content of a reviewer's file of corrections, with the file's path and hash at the time of reading."""

    path: Path
    sha256: str
    corrections: Corrections


@dataclass(frozen=True, slots=True, eq=False)
class TrackInputs:
    """The checked inputs of ``track``.

    recording: the recording, with the patient's height and the camera poses that the user gave; config: the settings,
    with the place of the patient whom a reviewer named; sha256: (path, hash) of every file of the recording, of the
    reference movements and of the events; review_file: None without corrections; pose_source: where the camera poses
    come from if they replace the recording's, else None; trials: None without events.
    """

    recording: Recording
    config: TrackConfig
    sha256: tuple[tuple[str, str], ...]
    review_file: ReviewFile | None
    pose_source: PoseSource | None
    calibration: CalibrationUsed | None = None
    trials: Trials | None = None

    @property
    def identity(self) -> str:
        """Return a SHA-256 (as a hexadecimal text) that identifies everything on which joints and measures depend:
        inputs, settings, camera poses, corrections, code and libraries.
        """
        review = "" if self.review_file is None else self.review_file.sha256
        poses = [camera.T_world_camera for camera in self.recording.cameras]
        settings = replace(self.config, motions=None)  # the file of movements is identified by its hash, not its path
        parts = as_json((self.sha256, poses, review, settings, versions(), code_digest()))
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    @property
    def review(self) -> Review:
        """Return the part of the corrections that tracking needs."""
        return NO_REVIEW if self.review_file is None else review_of(self.review_file.corrections)


def read_inputs(
    folder: Path, config: TrackConfig, user: UserInputs, known: Mapping[str, str] = MappingProxyType({})
) -> TrackInputs:
    """Read and check all inputs. known: by path, the SHA-256 of files of the recording whose hash is known already, so
    that they need not be hashed again.

    Raises InputError if the recording cannot be used, or if a user's file does not belong to the recording.
    """
    recording, source, calibration = with_height(open_recording(folder), config.height_m), None, None
    if user.calibration is not None:
        recording, source = with_poses(recording, user.calibration), PoseSource.FILE
        file = calibration_file(user.calibration)
        calibration = CalibrationUsed(*hash_files([file], file.parent)[0])
    frame_range(recording, config.start, config.stop)
    given = None if user.corrections is None else _read_review(user.corrections)
    trials = _read_events(recording, user.events)
    hashes = (*_hash_inputs(recording, config, known), *_hash_given(user.events))
    if given is not None:
        if any(camera.T_world_camera is None for camera in recording.cameras):
            recording, source = _in_world_of(given.corrections, recording), PoseSource.RESULTS
        _require_about(given, recording, hashes)
        config = _with_named_patient(config, given)
    return TrackInputs(recording, config, hashes, given, source, calibration, trials)


def _read_events(recording: Recording, given: Path | None) -> Trials | None:
    """Read the trials from the given file or, without a given file, from the recording's events.tsv; None if both are
    missing.
    """
    own = events_files(recording.folder)
    path = given or (own[0] if own else None)
    return None if path is None else read_trials(path, span_of(recording))


def _hash_given(events: Path | None) -> tuple[tuple[str, str], ...]:
    """Return the name and hash of an events file that the user gave, and of the file beside it that states units, if it
    exists.
    """
    if events is None:
        return ()
    files = [file for file in (events, sidecar_of(events)) if is_there(file)]
    return tuple((f"{GIVEN}{name}", digest) for name, digest in hash_files(files, events.parent))


def _read_review(path: Path) -> ReviewFile:
    """Read a file of corrections; raises InputError if the file does not hold corrections."""
    corrections = read_corrections(path)
    # hash the file now, since the viewer may add corrections to it during tracking
    ((_, digest),) = hash_files([path], path.parent)
    return ReviewFile(path, digest, corrections)


def _hash_inputs(recording: Recording, config: TrackConfig, known: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    movements = config.motion_file
    return (
        *hash_files(input_files(recording), recording.folder, known),
        *(hash_files([movements], movements.parent) if config.motion.uses_database else ()),
    )


def _in_world_of(corrections: Corrections, recording: Recording) -> Recording:
    """Return the recording with the camera poses of the results that a reviewer corrected. So the poses need not be
    found again, and places in the corrections stay valid even if the reviewer names another person as the patient.
    """
    poses = corrections.recording.poses
    cameras = tuple(replace(camera, T_world_camera=poses.get(camera.name)) for camera in recording.cameras)
    return replace(recording, cameras=cameras)


def _require_about(given: ReviewFile, recording: Recording, hashes: tuple[tuple[str, str], ...]) -> None:
    """Raise InputError if the corrections were made for another recording or other camera poses, or for frames that do
    not exist.
    """
    cameras = [ReviewedCamera(camera.name, camera.T_world_camera) for camera in recording.cameras]
    about = reviewed_recording(recording.folder.resolve().name, hashes, cameras)
    require_recording(given.path, given.corrections, about)
    require_frames(given.path, given.corrections, recording)


def _with_named_patient(config: TrackConfig, given: ReviewFile) -> TrackConfig:
    """Return the settings with the patient whom the reviewer named; raises InputError if the user names another
    person.
    """
    named = given.corrections.patient
    if named is None:
        return config
    if config.patient_xz_m is not None and not _names_the_same(config, named):
        (x, z), (own_x, own_z) = named.xz_m, config.patient_xz_m
        when = "" if config.patient_frame is None else f"@{config.patient_frame}"
        problem = f"names the patient at {x:.2f},{z:.2f}@{named.frame}, and --patient names {own_x:g},{own_z:g}{when}"
        raise InputError(given.path, problem, "leave --patient out, or take that correction back in the viewer")
    return replace(config, patient_xz_m=named.xz_m, patient_frame=named.frame)


def _names_the_same(config: TrackConfig, named: NamedPatient) -> bool:
    near = np.allclose(config.patient_xz_m or np.nan, named.xz_m, rtol=0, atol=SAME_PLACE_M)
    return near and config.patient_frame == named.frame
