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
from anchorpose.isolation.people import People, find_people
from anchorpose.isolation.scene import Scene, find_pieces, set_scene
from anchorpose.recording.reader import read_frames
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.opening import Opening, rank_openings
from anchorpose.tracker.review import Review

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
