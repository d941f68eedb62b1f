"""Clocks, calibration and room, from frames spread over the recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from anchorpose.calibration.calibration import Calibration, PoseRecord, PoseSource
from anchorpose.calibration.clock.clocks import Clocks
from anchorpose.calibration.clock.settled import settle_clocks
from anchorpose.calibration.people.camera_to_camera import CameraToCameraConfig
from anchorpose.calibration.world import find_world
from anchorpose.camera import Camera
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.tracker.best_opening import with_best_opening
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.facing import heading_of_patient
from anchorpose.tracker.review import NOTHING_SAID, Review
from anchorpose.tracker.room import Room, furnish_room, sample_recording


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """A recording on one clock and in one world, with the frames (positions ``chosen``) that told them."""

    recording: Recording
    clocks: Clocks
    calibration: Calibration
    chosen: tuple[int, ...]
    samples: tuple[FrameSet, ...]


def prepare_room(recording: Recording, config: TrackConfig, review: Review = NOTHING_SAID) -> Room:
    """Everything that is known before the first frame is followed."""
    settled = settle(recording, config)
    room = furnish_room(
        settled.recording, settled.clocks, settled.calibration, settled.chosen, settled.samples, config, review
    )
    return with_best_opening(room, config)


def settle(recording: Recording, config: TrackConfig) -> Settled:
    """Time and place of all cameras; clocks come out sharper with poses, poses found from people sharper with clocks.

    Raises InputError where a pose cannot be found.
    """
    unplaced = len(recording.cameras) > 1 and any(camera.T_world_camera is None for camera in recording.cameras)
    by_people = unplaced and recording.equipment is None
    settled = _settled(
        recording, recording.cameras, config, config.placing.first_look() if by_people else config.placing
    )
    if not unplaced:
        return settled
    if by_people:
        return _settled(recording, settled.calibration.cameras, config, config.placing)
    timed, clocks = settle_clocks(recording, settled.calibration.cameras, config.floor, config.clocks)
    chosen, samples = sample_recording(timed, config)
    return Settled(timed, clocks, settled.calibration, tuple(chosen), tuple(samples))


def _settled(
    recording: Recording, cameras: Sequence[Camera], config: TrackConfig, placing: CameraToCameraConfig
) -> Settled:
    """Clocks by what is known of the cameras' poses, then the poses that are not given."""
    timed, clocks = settle_clocks(recording, cameras, config.floor, config.clocks)
    chosen, samples = sample_recording(timed, config)
    calibration = calibrate(timed, samples, config, placing)
    return Settled(timed, clocks, calibration, tuple(chosen), tuple(samples))


def calibrate(
    recording: Recording, samples: Sequence[FrameSet], config: TrackConfig, placing: CameraToCameraConfig
) -> Calibration:
    """The poses of all cameras, given or found; the body model breaks the tie of equipment that is symmetric."""

    def tell_facing(cameras: tuple[Camera, ...], floor_m: float, headings: Sequence[np.ndarray]) -> int | None:
        records = tuple(PoseRecord(camera.name, PoseSource.EQUIPMENT) for camera in cameras)
        posed = replace(recording, cameras=cameras)
        provisional = Calibration(cameras, floor_m, (), (), records)
        timeless = Clocks((), None, 0)  # frames are paired already
        room = furnish_room(posed, timeless, provisional, range(len(samples)), samples, config, NOTHING_SAID)
        return heading_of_patient(room, samples, headings, config)

    return find_world(recording, samples, config.floor, config.equipment_pose, tell_facing, placing)
