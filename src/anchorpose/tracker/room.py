"""What is known before the first frame is followed: the world, the empty room, the equipment, the patient's place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anchorpose.calibration.world import Calibration, find_world
from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.isolation.background import BackgroundModel, learn_background
from anchorpose.isolation.people import PatientChoice, People, choose_patient, find_people
from anchorpose.isolation.scene import Scene, find_pieces, set_scene
from anchorpose.recording.reader import read_frames
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.tracker.config import TrackConfig

UP = np.array([0.0, 1.0, 0.0])
FACING = np.array([1.0, 0.0, 0.0])  # design: X of the world is the way the patient faces


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """cameras and scenes in the order of the recording; choice None where nobody was seen in the sampled frames."""

    recording: Recording
    calibration: Calibration
    scenes: tuple[Scene, ...]
    choice: PatientChoice | None

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras with the poses that are used."""
        return self.calibration.cameras


def prepare_room(recording: Recording, config: TrackConfig) -> Room:
    """Calibration, background of every camera, and which person is the patient, from frames spread over the recording."""
    samples = _sample_frames(recording, config.follow.samples)
    calibration = find_world(recording, samples, config.floor)
    scenes = tuple(
        set_scene(camera, _background(recording, number, samples, calibration, config), recording.equipment)
        for number, camera in enumerate(calibration.cameras)
    )
    sightings = [sight_people(frame_set, scenes, config) for frame_set in samples]
    return Room(recording, calibration, scenes, _choose(sightings, calibration, recording, config))


def sight_people(frame_set: FrameSet, scenes: Sequence[Scene], config: TrackConfig) -> People:
    """The people of one moment."""
    pieces = [
        None if depth is None else find_pieces(depth, scene, config.isolation)
        for depth, scene in zip(frame_set.depths_m, scenes, strict=True)
    ]
    return find_people(pieces, config.isolation)


def _sample_frames(recording: Recording, wanted: int) -> list[FrameSet]:
    count = len(recording.streams[0].files)
    chosen = np.unique(np.linspace(0, count - 1, min(wanted, count)).astype(int))
    return [next(iter(read_frames(recording, int(k), int(k) + 1))) for k in chosen]


def _background(
    recording: Recording, number: int, samples: Sequence[FrameSet], calibration: Calibration, config: TrackConfig
) -> BackgroundModel:
    camera = calibration.cameras[number]
    frames = [depth for sample in samples if (depth := sample.depths_m[number]) is not None]
    if not frames:
        where = recording.folder / camera.name
        raise InputError(where, "none of the sampled pictures can be read", "record or copy this camera again")
    return learn_background(
        recording.backgrounds_m[number], frames, camera, calibration.floor_height_m, config.isolation
    )


def _choose(
    sightings: Sequence[People], calibration: Calibration, recording: Recording, config: TrackConfig
) -> PatientChoice | None:
    """The first sampled frame that shows anybody decides; later ones say who stays."""
    first = next((k for k, sighting in enumerate(sightings) if sighting.people), None)
    if first is None:
        return None
    return choose_patient(
        sightings[first:], recording.equipment, config.patient_xz_m, _look_at(calibration.cameras[0]), config.isolation
    )


def _look_at(camera: Camera) -> np.ndarray:
    """(2,) X and Z of the place 2.5 m along the first camera's axis: where people are asked to stand."""
    place = camera.position_m + 2.5 * camera.require_pose()[:3, 2]
    return np.asarray(place[[0, 2]])
