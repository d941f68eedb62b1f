"""The recordings that an experiment is made on: simulated ones, or the user's own with reference skeletons."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from anchorpose.experiments.config import ExperimentConfig, Scene
from anchorpose.simulate import config as presets
from anchorpose.simulate.config import SimulationConfig

LOOSE_M = 0.014  # close to what the simulator refuses; ordinary clothes stand off by up to 0.009


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """One recording. simulation: how it is made, or None where ``folder`` is the user's."""

    name: str
    scene: Scene
    simulation: SimulationConfig | None
    folder: Path | None = None

    @property
    def drawn_by(self) -> str:
        """What its holes, segments and windows are drawn by: those of the paper's scene serve twice."""
        return self.name.replace(Scene.MATCHES, Scene.PAPER)

    @property
    def holes_are_cut(self) -> bool:
        """Whether the sizes of hole apply; other scenes bring their own occluders."""
        return self.scene in (Scene.PAPER, Scene.MATCHES, Scene.LOOSE, Scene.REAL)


def plan_clips(config: ExperimentConfig, real: Path | None) -> list[Clip]:
    """All test recordings, scene by scene."""
    clips = [
        Clip(f"{scene}-{seed}", scene, simulation_of(scene, seed, config))
        for scene in config.scenes
        if scene is not Scene.REAL
        for seed in config.seeds(scene)
    ]
    return clips + ([] if real is None else real_clips(real))


def real_clips(folder: Path) -> list[Clip]:
    """The recording folders below ``folder`` that have a reference skeleton."""
    found = sorted(path.parent for path in folder.glob("*/skeleton.npz") if (path.parent / "recording.json").is_file())
    return [Clip(f"real-{path.name}", Scene.REAL, None, path) for path in found]


def simulation_of(scene: Scene, seed: int, config: ExperimentConfig) -> SimulationConfig:
    """How a recording is simulated."""
    if scene in (Scene.PAPER, Scene.MATCHES):
        return presets.single(seed, config.seconds, config.fps)
    alone = presets.single(seed, config.scene_seconds, config.fps)
    crowded = presets.clinic(seed, config.scene_seconds, config.fps)
    match scene:
        case Scene.LOOSE:
            return replace(alone, clothing_m=LOOSE_M)
        case Scene.FRAME:
            return replace(alone, standing_frame=True)
        case Scene.CLINIC_FRONT:
            return replace(crowded, cameras=1)
        case Scene.CLINIC:
            return crowded
    raise ValueError(f"{scene} is not simulated")
