"""What is known before the first frame is followed: the world, the empty room, the equipment, the patient's place.

What a reviewer of earlier results said of some frames: which are of no use, and where joints are.

Where tracking may begin: the sampled frames that show the patient, by how well and how far apart from others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.body.corrected_joints import ToldJoints
from anchorpose.body.pose import LIMB_OF_JOINTS
from anchorpose.calibration.calibration import Calibration
from anchorpose.calibration.clock.clocks import Clocks
from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.isolation.background import BackgroundModel
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.people import PatientChoice, People, choose_patient, find_people
from anchorpose.isolation.scene import Scene, find_pieces, set_scene
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.recording.reader import read_frames
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.results.corrections import Corrections, JointCorrection
from anchorpose.tracker.config import TrackConfig

THERE_M = 0.5  # from the place that was named: beyond, somebody else is seen and the patient has not come yet
CROWDED_M = 1.0  # from axis to axis: an outstretched arm and half a trunk
MERGED = 0.5  # worth of a frame with fewer people than usual: somebody may stand so near that two are taken for one


@dataclass(frozen=True, slots=True, eq=False)
class Opening:
    """A frame (position in the recording) that shows the patient, and where he stands in it.

    score: 0 to 1, by the surface that is seen of him and the way to the next person alone; whole: 0 to 1, that surface
    against the usual one; people: seen in the frame.
    """

    frame: int
    choice: PatientChoice
    score: float
    whole: float
    people: int


def rank_openings(
    frames: Sequence[int], sightings: Sequence[People], calibration: Calibration, recording: Recording,
    config: TrackConfig,
) -> tuple[Opening, ...]:  # fmt: skip
    """The frames that show the patient, first those that show him well and nobody near him; if he was named, those with
    somebody at that place. Of equals the earlier comes first: the patient is named as he stands there.

    frames: positions in the recording, sightings: the people of each.
    """
    place = look_at(calibration.cameras[0])
    openings, seen = [], []
    for number, frame in enumerate(frames):
        others = [*sightings[:number], *sightings[number + 1 :]]
        choice = choose_patient(
            [sightings[number], *others], recording.equipment, config.patient_xz_m, place, config.isolation
        )
        if choice is not None:
            openings.append(Opening(frame, choice, 0.0, 0.0, len(sightings[number].people)))
            seen.append(_patient_and_distance(sightings[number], choice))
    if not openings:
        return ()
    if config.patient_xz_m is not None:
        named_m = [float(np.linalg.norm(opening.choice.ground_xz_m - config.patient_xz_m)) for opening in openings]
        there = [opening for opening, off_m in zip(openings, named_m, strict=True) if off_m < THERE_M]
        return tuple(there or openings)
    ordinary_m2 = float(np.median([area_m2 for area_m2, _ in seen]))
    sure = any(opening.choice.sure for opening in openings)
    usual = float(np.median([opening.people for opening in openings]))
    scored = []
    for opening, (area_m2, distance_m) in zip(openings, seen, strict=True):
        whole, apart = min(area_m2 / ordinary_m2, 1.0), min(distance_m / CROWDED_M, 1.0)
        possible = float(opening.choice.sure or not sure) * (1.0 if opening.people >= usual else MERGED)
        scored.append(replace(opening, score=round(possible * whole * apart, 1), whole=whole))
    return tuple(sorted(scored, key=lambda one: -one.score))


def _patient_and_distance(sighting: People, choice: PatientChoice) -> tuple[float, float]:
    """Surface of the patient that is seen, m^2, and how far the nearest other person is, m (inf where he is alone).

    More surface than usual is no better: it may be somebody else's who touches him.
    """
    axes = np.array([person.ground_xz_m for person in sighting.people])
    distance = np.linalg.norm(axes - choice.ground_xz_m, axis=1)
    patient = int(distance.argmin())
    return sighting.people[patient].area_m2, float(np.delete(distance, patient).min(initial=np.inf))


def look_at(camera: Camera) -> np.ndarray:
    """(2,) X and Z of the place 2.5 m along the first camera's axis: where people are asked to stand."""
    place = camera.position_m + 2.5 * camera.require_pose()[:3, 2]
    return np.asarray(place[[0, 2]])


@dataclass(frozen=True, slots=True, eq=False)
class Review:
    """joints: by frame number. unusable: first and last frame, both included, and the sentence that says why."""

    joints: dict[int, ToldJoints] = field(default_factory=dict)
    unusable: tuple[tuple[int, int, str], ...] = ()

    def why_unusable(self, frame: int) -> str | None:
        """The sentence of the first interval that holds the frame, None where the frame may be used."""
        return next((why for first, last, why in self.unusable if first <= frame <= last), None)


NOTHING_SAID: Final = Review()


def held_joints(review: Review, frames: Sequence[int]) -> np.ndarray:
    """(t, 21) bool: the told joints of the frames with these numbers, and all joints of their limbs."""
    held = np.zeros((len(frames), JOINT_COUNT), bool)
    for row, frame in enumerate(frames):
        told = review.joints.get(frame)
        if told is not None:
            held[row] = np.isin(LIMB_OF_JOINTS, LIMB_OF_JOINTS[told.joint])
    return held


def review_of(corrections: Corrections) -> Review:
    """What tracking needs of a file of corrections."""
    by_frame: dict[int, list[JointCorrection]] = {}
    for entry in corrections.joints:
        by_frame.setdefault(entry.frame, []).append(entry)
    unusable = tuple(
        (gone.first_frame, gone.last_frame, f"marked as unusable by {gone.who} on {gone.when[:10]}: {gone.reason}")
        for gone in corrections.unusable
    )
    return Review({frame: _told(entries) for frame, entries in by_frame.items()}, unusable)


def require_frames(path: Path, review: Review, recording: Recording) -> None:
    """Raises InputError where joints are corrected in a frame that the recording does not have."""
    strangers = sorted(set(review.joints) - set(recording.streams[0].frame.tolist()))
    if strangers:
        problem = f"corrects joints of frame {strangers[0]}, which the recording does not have"
        raise InputError(path, problem, "take that correction out")


def _told(entries: list[JointCorrection]) -> ToldJoints:
    return ToldJoints(
        joint=np.array([JOINT_INDEX[entry.joint] for entry in entries]),
        position_m=np.array([entry.position_m for entry in entries]),
        sigma_m=np.array([entry.sigma_m for entry in entries]),
    )


UP = np.array([0.0, 1.0, 0.0])
BLIND_SAMPLES = 3  # times as many where the empty room has to be put together from moments in which it is free
FACING = np.array([1.0, 0.0, 0.0])  # design: X of the world is the way the patient faces


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """recording: on one clock; cameras and scenes in its order; openings: where tracking may begin, the best first,
    none where nobody was seen in the sampled frames; review: what somebody said who looked at earlier results."""

    recording: Recording
    clocks: Clocks
    calibration: Calibration
    scenes: tuple[Scene, ...]
    openings: tuple[Opening, ...]
    review: Review

    @property
    def opening(self) -> Opening | None:
        """Where tracking begins."""
        return self.openings[0] if self.openings else None

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
    openings = rank_openings([chosen[k] for k in usable], sightings, calibration, recording, config)
    return Room(recording, clocks, calibration, scenes, openings, review)


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
