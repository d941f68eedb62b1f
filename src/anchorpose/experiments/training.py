"""What methods learn from: movements for the dynamics, and recordings on which settings are chosen. Never tested on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.experiments.clips import Clip, simulation_of
from anchorpose.experiments.config import ExperimentConfig, Scene
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import Speed
from anchorpose.tracking.motion_file import ReferenceClips, write_motions

KINDS: Final[tuple[tuple[str, tuple[str, ...], Speed], ...]] = (
    ("upper body, slow", ("reach", "arm-raise", "head"), "slow"),
    ("lower body, slow", ("squat", "weight-shift", "trunk", "steps"), "slow"),
    ("upper body, fast", ("reach", "arm-raise", "head"), "fast"),
    ("lower body, fast", ("squat", "weight-shift", "trunk", "steps"), "fast"),
)
"""The paper's samples: "upper and lower body movements", "slow, normal to fast"; normal lies between."""


def training_clips(config: ExperimentConfig) -> list[Clip]:
    """The recordings, each of one kind and another body; together as long as the samples that are asked for."""
    seconds = max(config.training_samples / config.training_recordings, config.segment_frames + 1) / config.fps
    clips = []
    for number in range(config.training_recordings):
        name, motions, speed = KINDS[number % len(KINDS)]
        seed = config.training_seed + number
        simulation = replace(
            simulation_of(Scene.PAPER, seed, config),
            seconds=seconds, motions=motions, speed=speed,
        )  # fmt: skip
        clips.append(Clip(f"training-{seed} ({name})", Scene.PAPER, simulation))
    return clips


def write_movements(path: Path, clips: list[Clip], samples: int) -> None:
    """The joints of the training recordings as reference movements, so many frames in all.

    The paper takes them from the sensor's skeleton on unoccluded data; here they are the simulator's own.
    """
    joints, names, rates, left = list[np.ndarray](), list[str](), list[float](), samples
    for clip in clips:
        if clip.simulation is None:
            raise ValueError(f"{clip.name} is not simulated")
        clinic = draw_clinic(clip.simulation)
        moved = clinic.act(clinic.true_times_s(0)).joints_m()[: max(left, 0)]
        if len(moved):
            joints.append(moved)
            names.append(clip.name)
            rates.append(clip.simulation.fps)
        left -= len(moved)
    write_motions(path, ReferenceClips(tuple(joints), tuple(names), tuple(rates)))
