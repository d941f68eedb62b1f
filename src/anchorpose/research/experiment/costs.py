"""Estimate roughly how long the tasks of an experiment that have no result yet will take on an idle core."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from anchorpose.research.experiment.clips import Clip
from anchorpose.research.experiment.config import ExperimentConfig, Scene
from anchorpose.research.experiment.method import Family, Method
from anchorpose.research.experiment.plan import Kind, Task

# time per frame of a scene, as a multiple of the time per frame of the paper's scene
COST_FACTOR: Final = {Scene.CLINIC_FRONT: 1.5, Scene.CLINIC: 3.0}
USUAL_FORM_S: Final = 0.02  # s per frame for one form of the framework, without matching (``Method.frame_ms``)
USUAL_OWN_S: Final = 0.15  # s per frame for this project's tracker
# time per frame and camera to simulate a recording and track it for the reference, as a multiple of ``Costs.own_s``,
# the time per frame of this project's tracker
MAKING: Final = 2.0


@dataclass(frozen=True, slots=True)
class Costs:
    """Estimated computing times on one core, in seconds, by the key of the method."""

    # s per frame for all forms (variants) of the paper's framework and all sizes of hole together; a sum of separate
    # times would be too long, since forms and sizes share descriptors and matches
    frame_s: Mapping[str, float]
    alone_s: Mapping[str, float]  # s per frame, for one form of the framework and one size of hole
    window_s: Mapping[str, float]  # s per pair of frames whose matches are compared
    own_s: float  # s per frame for this project's tracker, including the time to learn the body

    def of(self, task: Task, config: ExperimentConfig) -> float:
        """Return the estimated seconds of a task on one core."""
        clip, method = task.clip, task.method
        factor = COST_FACTOR.get(clip.scene, 1.0)
        # the number of frames of a real recording is unknown until the recording is opened; 40 is a guess
        frames = 40 if clip.simulation is None else clip.simulation.frames
        if task.kind is Kind.MATCHED:
            return factor * task.pairs * self.window_s[method.key]
        if method.family is Family.TRACKER:
            return factor * frames * self.own_s
        tracked = min(config.segments, frames // config.segment_frames) * config.segment_frames
        if clip.scene is Scene.PAPER:
            return tracked * self.frame_s[method.key] * len(task.forms) / _forms(config)
        return factor * tracked * self.alone_s[method.key] * len(task.forms)

    def making(self, clip: Clip) -> float:
        """Return the seconds to simulate a clip and to make its reference (``given.Reference``) by tracking it."""
        if clip.simulation is None:
            return 10.0
        return 5.0 + MAKING * self.own_s * clip.simulation.frames * clip.simulation.cameras


def _forms(config: ExperimentConfig) -> int:
    """Return the number of times that a method tracks one recording of the paper's scene: once for each pair of a form
    and a size of hole with which it runs.
    """
    ends = min(len(config.holes_m), 2)
    between = sum(form.refined for form in config.forms)
    return ends * len(config.forms) + between * (len(config.holes_m) - ends)


def usual_costs(methods: Sequence[Method], config: ExperimentConfig) -> Costs:
    """Return the costs on an idle core, estimated from each method's approximate time per frame (``frame_ms``)."""
    forms, method_s = _forms(config), {method.key: method.frame_ms / 1000.0 for method in methods}
    return Costs(
        {key: forms * USUAL_FORM_S + len(config.holes_m) * spent for key, spent in method_s.items()},
        {key: USUAL_FORM_S + spent for key, spent in method_s.items()},
        {key: 0.05 + 3.0 * spent for key, spent in method_s.items()},
        USUAL_OWN_S,
    )


def duration(seconds: float) -> str:
    """Format a duration as minutes, or as hours and minutes from 90 minutes on."""
    minutes = max(1, round(seconds / 60))
    return f"{minutes} minutes" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
