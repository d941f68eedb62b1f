"""Simulated clinics in memory, as calibration gets them: nothing is written."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from anchorpose.recording.recording import UNKNOWN, FrameSet, Recording
from anchorpose.simulate.clinic import Clinic, draw_clinic
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.shoot import set_up


def shoot(config: SimulationConfig, samples: int = 8) -> tuple[Clinic, Recording, list[FrameSet]]:
    """A clinic, its recording without poses but with the empty room, and frames spread over it."""
    clinic = draw_clinic(config)
    studio = set_up(clinic)
    chosen = np.unique(np.linspace(0, config.frames - 1, samples).astype(int)).tolist()
    frames = [
        FrameSet(
            frame=k,
            time_s=k / config.fps,
            depths_m=tuple((depth * 0.001).astype(np.float32) for depth in studio.shoot(k).depths_mm),
        )
        for k in chosen
    ]
    empty = tuple((studio.background_mm(index) * 0.001).astype(np.float32) for index in range(config.cameras))
    recording = Recording(
        folder=Path("clinic"),
        cameras=tuple(replace(camera, T_world_camera=None) for camera in clinic.cameras),
        streams=(),
        backgrounds_m=empty,
        equipment=clinic.equipment,
        subject=UNKNOWN,
    )
    return clinic, recording, frames


def bare(recording: Recording) -> Recording:
    """The recording without pictures of the empty room."""
    return replace(recording, backgrounds_m=(None,) * len(recording.cameras))
