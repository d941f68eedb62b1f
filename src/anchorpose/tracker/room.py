"""What is known before the first frame is followed: the world, the empty room, the equipment, the patient's place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anchorpose.calibration.calibration import Calibration
from anchorpose.calibration.clock.clocks import Clocks
from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.isolation.background import BackgroundModel
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.people import PatientChoice, People, choose_patient, find_people
from anchorpose.isolation.scene import Scene, find_pieces, set_scene
from anchorpose.recording.reader import read_frames
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.review import Review

UP = np.array([0.0, 1.0, 0.0])
THERE_M = 0.5  # from the place that was named: beyond, somebody else is seen and the patient has not come yet
CROWDED_M = 1.0  # from axis to axis: an outstretched arm and half a trunk
BLIND_SAMPLES = 3  # times as many where the empty room has to be put together from moments in which it is free
MERGED = 0.5  # worth of a frame with fewer people than usual: somebody may stand so near that two are taken for one
FACING = np.array([1.0, 0.0, 0.0])  # design: X of the world is the way the patient faces


@dataclass(frozen=True, slots=True, eq=False)
class Opening:
    """The frame (position in the recording) in which the patient is seen best, and where he stands in it."""

    frame: int
    choice: PatientChoice


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """recording: on one clock; cameras and scenes in its order; opening None where nobody was seen in the sampled
    frames; review: what somebody said who looked at earlier results."""

    recording: Recording
    clocks: Clocks
    calibration: Calibration
    scenes: tuple[Scene, ...]
    opening: Opening | None
    review: Review

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras with the poses that are used."""
        return self.calibration.cameras


def sample_recording(recording: Recording, config: TrackConfig) -> tuple[list[int], list[FrameSet]]:
    """Positions of frames spread over what is to be tracked, and these frames."""
    first, count = config.start, len(recording.streams[0].time_s[config.start : config.stop])
    wanted = config.follow.samples * (1 if all(room is not None for room in recording.backgrounds_m) else BLIND_SAMPLES)
    chosen = np.unique(np.linspace(first, first + count - 1, min(wanted, count)).astype(int)).tolist()
    return chosen, [next(iter(read_frames(recording, k, k + 1))) for k in chosen]


def furnish_room(
    recording: Recording, clocks: Clocks, calibration: Calibration, chosen: Sequence[int], samples: Sequence[FrameSet],
    config: TrackConfig, review: Review,
) -> Room:  # fmt: skip
    """Background of every camera and who is the patient, from frames at positions ``chosen``.

    Tracking does not begin in a frame that a reviewer marked as unusable, unless all are.
    """
    scenes = tuple(
        set_scene(
            camera,
            _background(recording, number, samples, calibration, config),
            recording.equipment,
            config.isolation,
        )
        for number, camera in enumerate(calibration.cameras)
    )
    usable = [k for k, frame_set in enumerate(samples) if review.why_unusable(frame_set.frame) is None]
    usable = usable or list(range(len(samples)))
    sightings = [sight_people(samples[k], scenes, config) for k in usable]
    opening = choose_opening([chosen[k] for k in usable], sightings, calibration, recording, config)
    return Room(recording, clocks, calibration, scenes, opening, review)


def sight_people(frame_set: FrameSet, scenes: Sequence[Scene], config: TrackConfig) -> People:
    """The people of one moment."""
    pieces = [
        None if depth is None else find_pieces(depth, scene, config.isolation)
        for depth, scene in zip(frame_set.depths_m, scenes, strict=True)
    ]
    return find_people(pieces, config.isolation)


def _background(
    recording: Recording, number: int, samples: Sequence[FrameSet], calibration: Calibration, config: TrackConfig
) -> BackgroundModel:
    camera = calibration.cameras[number]
    frames = [depth for sample in samples if (depth := sample.depths_m[number]) is not None]
    if not frames:
        where = recording.folder / camera.name
        raise InputError(where, "none of the sampled pictures can be read", "record or copy this camera again")
    return learn_background(
        recording.backgrounds_m[number],
        frames,
        camera,
        calibration.floor_height_m,
        config.isolation,
        recording.equipment,
    )


def choose_opening(
    frames: Sequence[int], sightings: Sequence[People], calibration: Calibration, recording: Recording,
    config: TrackConfig,
) -> Opening | None:  # fmt: skip
    """The first of the frames that shows the patient well and nobody near him; if he was named, the first with
    somebody at that place.

    frames: positions in the recording, sightings: the people of each. None where nobody is seen in any of them.
    """
    look_at = _look_at(calibration.cameras[0])
    openings, seen = [], []
    for number, frame in enumerate(frames):
        others = [*sightings[:number], *sightings[number + 1 :]]
        choice = choose_patient(
            [sightings[number], *others], recording.equipment, config.patient_xz_m, look_at, config.isolation
        )
        if choice is not None:
            openings.append(Opening(frame, choice))
            seen.append(_patient_and_distance(sightings[number], choice))
    if not openings:
        return None
    if config.patient_xz_m is not None:
        named_m = [float(np.linalg.norm(opening.choice.ground_xz_m - config.patient_xz_m)) for opening in openings]
        there = [opening for opening, off_m in zip(openings, named_m, strict=True) if off_m < THERE_M]
        return (there or openings)[0]
    ordinary_m2 = float(np.median([area_m2 for area_m2, _ in seen]))
    sure = any(opening.choice.sure for opening in openings)
    counts = [len(sightings[frames.index(opening.frame)].people) for opening in openings]
    usual = float(np.median(counts))
    scores = [
        float(opening.choice.sure or not sure) * min(area_m2 / ordinary_m2, 1.0) * min(distance_m / CROWDED_M, 1.0)
        * (1.0 if count >= usual else MERGED)
        for opening, count, (area_m2, distance_m) in zip(openings, counts, seen, strict=True)
    ]  # fmt: skip
    return openings[int(np.argmax(np.round(scores, 1)))]  # of equals the first: the patient is named as he stands there


def _patient_and_distance(sighting: People, choice: PatientChoice) -> tuple[float, float]:
    """Surface of the patient that is seen, m^2, and how far the nearest other person is, m (inf where he is alone).

    More surface than usual is no better: it may be somebody else's who touches him.
    """
    axes = np.array([person.ground_xz_m for person in sighting.people])
    distance = np.linalg.norm(axes - choice.ground_xz_m, axis=1)
    patient = int(distance.argmin())
    return sighting.people[patient].area_m2, float(np.delete(distance, patient).min(initial=np.inf))


def _look_at(camera: Camera) -> np.ndarray:
    """(2,) X and Z of the place 2.5 m along the first camera's axis: where people are asked to stand."""
    place = camera.position_m + 2.5 * camera.require_pose()[:3, 2]
    return np.asarray(place[[0, 2]])
