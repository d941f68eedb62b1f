"""Calibration and room, from frames spread over the recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from anchorpose.calibration.calibration import Calibration, PoseRecord, PoseSource
from anchorpose.calibration.world import find_world
from anchorpose.camera import Camera
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.facing import heading_of_patient
from anchorpose.tracker.room import Room, furnish_room, sample_recording


def prepare_room(recording: Recording, config: TrackConfig) -> Room:
    """Everything that is known before the first frame is followed."""
    chosen, samples = sample_recording(recording, config)
    return furnish_room(recording, calibrate(recording, samples, config), chosen, samples, config)


def calibrate(recording: Recording, samples: Sequence[FrameSet], config: TrackConfig) -> Calibration:
    """The poses of all cameras, given or found; the body model breaks the tie of equipment that is symmetric.

    Raises InputError where a pose cannot be found.
    """

    def tell_facing(cameras: tuple[Camera, ...], floor_m: float, headings: Sequence[np.ndarray]) -> int | None:
        records = tuple(PoseRecord(camera.name, PoseSource.EQUIPMENT) for camera in cameras)
        posed = replace(recording, cameras=cameras)
        room = furnish_room(
            posed, Calibration(cameras, floor_m, (), (), records), list(range(len(samples))), samples, config
        )
        return heading_of_patient(room, samples, headings, config)

    return find_world(recording, samples, config.floor, config.equipment_pose, tell_facing)
